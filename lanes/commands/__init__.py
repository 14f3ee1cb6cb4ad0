"""The longer commands of `python -m lanes`, a module each: its options, and the function that runs it."""
