"""The camera: lens model, pose, camera file, chessboard calibration, field of view."""
