"""Camera-based lane finding: the camera, the classic pipeline, the lane tracker and whole drives."""
