"""Lens calibration from pictures of a chessboard."""
