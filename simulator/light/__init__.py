"""Sunlight, shading, glare, exposure, and development of light to images."""
