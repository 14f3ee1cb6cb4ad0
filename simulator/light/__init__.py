"""Sunlight, shading, glare, exposure and the camera's development of light to images."""
