"""Video files: read, write, process frame by frame."""
