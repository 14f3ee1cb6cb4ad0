"""Scripts for the developers of the project: python -m tools.NAME."""
