"""Noise, ground texture and the brush that draws solid objects through the lens."""
