"""The camera: lens model, pose, camera file, calibration from chessboards, pose from lane lines."""
