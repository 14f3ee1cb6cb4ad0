"""Scores on stills that were labelled by hand."""
