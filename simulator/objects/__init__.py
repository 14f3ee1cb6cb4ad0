"""Solid objects: vehicles, walls, bridges, roadside furniture, shadows, bonnet."""
