"""The commands of python -m lanes, one module per command."""
