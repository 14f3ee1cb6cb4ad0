"""The book: `make book` builds the static site."""
