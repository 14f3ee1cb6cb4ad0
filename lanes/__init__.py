"""Camera-based lane finding: the camera, the classic pipeline, the lane tracker and whole drives."""

__version__ = "0.1.0"
