"""The offline page of an annotated drive."""
