"""Wrong answers to the exercises of chapter 6: code that sets it, and a part of its hint."""

_PEAKS = (
    'width_binary = finders["hls_sobel"].recipe.thresholds.masks(width_view)["combined"]\n'
    "width_peaks = helpers.find_peaks(helpers.lane_histogram(width_binary))\n"
    "width_m = np.ptp(width_peaks)"
)
_CLIMB = """
def climb_and_coast(binary, column):
    pixels, step, caught = cv2.findNonZero(binary).reshape(-1, 2), 0, []
    for bottom in range(720, 0, -80):
        inside = (pixels[:, 1] >= bottom - 80) & (pixels[:, 1] < bottom) & (np.abs(pixels[:, 0] - column) <= 80)
        caught.append(pixels[inside])
        if inside.sum() >= 50:
            step, column = pixels[inside, 0].mean() - column, pixels[inside, 0].mean()
        {else_branch}
    return np.concatenate(caught)
"""

WRONG_ANSWERS = {
    "6.1": [
        (_PEAKS, "distance in columns"),
        (_PEAKS + " * 3.7 / 700", "another warp"),
        ("width_m = np.nan", "NaN"),
        ("width_m = (right_start - left_start) * helpers.metres_per_pixel(pose_warp, camera)[0]", "how many metres"),
    ],
    "6.2": [
        (_CLIMB.format(else_branch=""), "40% of the pixels"),
        (_CLIMB.format(else_branch="else: column -= step"), "with its sign"),
        ("climb_and_coast = lambda binary, column: np.argwhere(binary)", "(column, row)"),
        ("climb_and_coast = lambda binary, column: np.argwhere(binary)[:, ::-1]", "another line"),
    ],
}
