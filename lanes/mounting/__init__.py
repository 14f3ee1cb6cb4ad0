"""How the camera is mounted, from the lane lines of a drive."""
