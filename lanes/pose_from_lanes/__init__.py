"""Camera pose from the lane lines in a drive's own pictures."""
