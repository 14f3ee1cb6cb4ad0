"""The checks of the exercises, a file for some chapters each."""
