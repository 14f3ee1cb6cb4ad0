"""From the description of a drive to frames and video files."""
