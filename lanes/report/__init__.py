"""The report of a drive: one HTML file with the video, synchronised curves and the worst moments, for offline use."""
