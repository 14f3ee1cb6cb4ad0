"""Roads and chessboards rendered with exact ground truth."""
