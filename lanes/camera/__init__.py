"""The camera: lens model, pose, camera file, chessboard calibration, pose from lane lines, field of view."""
