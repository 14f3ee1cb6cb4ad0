"""Sunlight, shading, glare, and what lens and exposure do to the light."""
