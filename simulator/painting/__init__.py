"""Noise, ground texture, and polygons drawn through the lens model."""
