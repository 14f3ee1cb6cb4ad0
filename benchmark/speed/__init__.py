"""Time per frame, time from file to file, and memory."""
