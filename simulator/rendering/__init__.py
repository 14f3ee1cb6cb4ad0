"""Rendering of a drive to frames and video files."""
