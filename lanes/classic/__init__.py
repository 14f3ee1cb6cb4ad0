"""The classic path: threshold, warp, windows, parabola; three recipes."""
