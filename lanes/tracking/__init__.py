"""One drive: the lane from frame to frame."""
