"""Wrong answers to the exercise of chapter 2: code that sets it, and a part of its hint."""

_EACH_BOARD = """board_errors_px = []
for rotation, translation, seen in zip(board_rotations, board_translations, image_points):
    projected, _ = cv2.projectPoints(board_points, rotation, translation, lens_matrix, lens_distortion)
    projected, seen = projected.reshape(-1, 2), seen.reshape(-1, 2)
"""

WRONG_ANSWERS = {
    "2.1": [
        ("board_errors_px = lens_rms_px", "one for each board"),
        ("board_errors_px = [lens_rms_px] * len(image_points)", "Each board has its own"),
        (_EACH_BOARD + "    board_errors_px.append(cv2.norm(projected, seen, cv2.NORM_L2) / 54)", "OpenCV's tutorial"),
        (_EACH_BOARD + "    board_errors_px.append(np.sqrt(((projected - seen) ** 2).mean()))", "too small by sqrt(2)"),
        (
            _EACH_BOARD + "    board_errors_px.append(np.sqrt(((projected[:, None] - seen) ** 2).sum(axis=2).mean()))",
            "reshape before you subtract",
        ),
        (
            _EACH_BOARD + "    board_errors_px.append(np.linalg.norm(projected - seen, axis=1).mean())",
            "root of the mean of the squared",
        ),
    ],
}
