"""Solid objects: vehicles, walls, bridges, roadside furniture, their shadows, the bonnet."""
