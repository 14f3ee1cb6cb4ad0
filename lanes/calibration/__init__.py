"""Chessboard pictures to a calibrated lens."""
