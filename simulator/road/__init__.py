"""The road: its geometry, surface, markings and ground truth."""
