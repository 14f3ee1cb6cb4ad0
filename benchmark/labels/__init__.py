"""Scores on hand-labelled stills."""
