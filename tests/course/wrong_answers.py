"""Wrong answers to the exercises: code that sets them, and a part of their hints."""

WRONG_ANSWERS: dict[str, list[tuple[str, str]]] = {}

_ERRORS = "best = np.polyfit(paint_rows, paint_columns, 1)\nerrors = np.polyval(best, paint_rows) - paint_columns\n"
WRONG_ANSWERS["1.1"] = [
    (_ERRORS + "best_ruler_px = abs(errors).mean()", "is a mean of the distances"),
    (_ERRORS + "best_ruler_px = (-errors).max()", "on one side only"),
    (_ERRORS + "best_ruler_px = abs(errors)", "one number is needed"),
    (
        "best = np.polyfit(paint_columns, paint_rows, 1)\n"
        "best_ruler_px = abs(np.polyval(best, paint_columns) - paint_rows).max()",
        "Swap the first two arguments",
    ),
    ("best_ruler_px = abs(ruler_miss).max()", "Fit all rows"),
]

_EACH_BOARD = """board_errors_px = []
for rotation, translation, seen in zip(board_rotations, board_translations, image_points):
    projected, _ = cv2.projectPoints(board_points, rotation, translation, lens_matrix, lens_distortion)
    projected, seen = projected.reshape(-1, 2), seen.reshape(-1, 2)
    board_errors_px.append({})
"""
WRONG_ANSWERS["2.1"] = [
    ("board_errors_px = lens_rms_px", "one for each board"),
    ("board_errors_px = [lens_rms_px] * len(image_points)", "Each board has its own"),
    (_EACH_BOARD.format("cv2.norm(projected, seen, cv2.NORM_L2) / 54"), "OpenCV's tutorial"),
    (_EACH_BOARD.format("np.sqrt(((projected - seen) ** 2).mean())"), "too small by sqrt(2)"),
    (_EACH_BOARD.format("np.sqrt(((projected[:, None] - seen) ** 2).sum(axis=2).mean())"), "reshape before"),
    (_EACH_BOARD.format("np.linalg.norm(projected - seen, axis=1).mean()"), "root of the mean of the squared"),
]

_UNDISTORT = """
def undistort_pixel(u, v, matrix, distortion):
    (f_x, c_x), (f_y, c_y) = matrix[0, [0, 2]], matrix[1, [1, 2]]
    k1, k2, p1, p2, k3 = distortion
    x, y = x_d, y_d = (u - c_x) / f_x, (v - c_y) / f_y
    for _ in range(20):
        r2 = x**2 + y**2
        radial = 1 + k1 * r2 + k2 * r2**2 + k3 * r2**3
        shift_x, shift_y = 2 * p1 * x * y + p2 * (r2 + 2 * x**2), p1 * (r2 + 2 * y**2) + 2 * p2 * x * y
        x, y = (x_d - shift_x) / radial, (y_d - shift_y) / radial
    return f_x * x + c_x, f_y * y + c_y
"""
_DIVISION = "x, y = (x_d - shift_x) / radial, (y_d - shift_y) / radial"
WRONG_ANSWERS["3.1"] = [
    (_UNDISTORT.replace("range(20)", "range(3)"), "Repeat until it no longer moves"),
    (_UNDISTORT.replace("range(20)", "range(0)"), "x_d and y_d stay the same"),
    (_UNDISTORT.replace(_DIVISION, "x, y = x_d / radial - shift_x, y_d / radial - shift_y"), "then divide"),
    (_UNDISTORT.replace("k1, k2, p1, p2, k3", "k1, k2, p2, p1, k3"), "p1 and p2 are exchanged"),
    (_UNDISTORT.replace("k1, k2, p1, p2, k3", "k1, k2, k3, p1, p2"), "the order of the five numbers"),
    (_UNDISTORT.replace(_DIVISION, _DIVISION.replace("_d", "")), "keep x_d and y_d"),
    (_UNDISTORT.replace("x_d - shift_x", "x_d + shift_x").replace("y_d - s", "y_d + s"), "have the wrong sign"),
    (_UNDISTORT.replace("x_d - shift_x", "x_d").replace("y_d - shift_y", "y_d"), "are missing"),
    (_UNDISTORT.replace("/ radial", "* radial"), "the wrong way"),
    (_UNDISTORT.replace("(u - c_x)", "u").replace("(v - c_y)", "v"), "the principal point must stay"),
    (_UNDISTORT.replace("return f_x * x + c_x, f_y * y + c_y", "return x, y"), "the principal point must stay"),
    (_UNDISTORT.replace("(x_d - shift_x)", "(x - shift_x)").replace("range(20)", "range(3)"), "x_d and y_d stay"),
    ("def undistort_pixel(u, v, matrix, distortion):\n    return u", "return two numbers"),
]

_TO_METRES = """def to_metres(u, v):
    (far_x, left_y), (near_x, right_y) = rectangle_m[0], rectangle_m[2]
    x, y = far_x + (near_x - far_x) * v / 720, left_y + (right_y - left_y) * (u - 200) / 880
    return """
WRONG_ANSWERS["4.1"] = [
    ("my_source_px = source_px", "becomes narrower with the distance"),
    ("my_source_px = source_px[:, ::-1]", "Is the order (column, row)?"),
    ("my_source_px = source_px[[0, 2, 1, 3]]", "the edges cross"),
    ("my_source_px = source_px[[2, 3, 0, 1]]", "mirrored or upside down"),
    ("my_source_px = source_px[[1, 0, 3, 2]]", "mirrored or upside down"),
    ("my_source_px = source_px[0]", "four points"),
]
WRONG_ANSWERS["4.2"] = [
    (_TO_METRES + "x, -y", "y is positive to the left"),
    (_TO_METRES + "y, x", "Return x (forward) first"),
    (_TO_METRES + "x - near_x, y", "The bottom row is not below the camera"),
    (_TO_METRES + "near_x + far_x - x, y", "Row 0 is the far end"),
    (_TO_METRES + "x", "return two numbers"),
    ("def to_metres(u, v):\n    return (720 - v) * 30 / 720, (640 - u) * 3.7 / 700", "corners"),
]

_MASK = "def paint_mask(above):\n    hls = cv2.cvtColor(above, cv2.COLOR_RGB2HLS)\n    return "
_EDGES = """
def relative_edges(lightness):
    edges = np.abs(cv2.Sobel(lightness, cv2.CV_32F, 1, 0, ksize=3)) / 4
    return """
WRONG_ANSWERS["5.1"] = [
    (_MASK + "cv2.inRange(hls[..., 1], 100, 255)", "Too many pixels are not paint"),
    ('paint_mask = lambda above: recipes["hls_sobel"].thresholds.masks(above)["combined"]', "Too many pixels"),
    ("paint_mask = helpers.saturation_mask", "white dashes are missing"),
    (_MASK + "hls[..., 2] * 0", "the mask is empty"),
    (_MASK + "hls", "a mask has the shape"),
]
WRONG_ANSWERS["5.2"] = [
    (_EDGES + "np.where(edges >= 6, 255, 0).astype(np.uint8)", "Divide the gradient by the brightness"),
    (_EDGES + "np.where(edges >= 0.1 * edges.max(), 255, 0).astype(np.uint8)", "no scale"),
    (_EDGES + "np.where(edges >= 0, 255, 0).astype(np.uint8)", "covers 100%"),
    (_EDGES + "edges", "a mask has the shape"),
]

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
WRONG_ANSWERS["6.1"] = [
    (_PEAKS, "distance in columns"),
    (_PEAKS + " * 3.7 / 700", "another warp"),
    ("width_m = np.nan", "NaN"),
    ("width_m = (right_start - left_start) * helpers.metres_per_pixel(pose_warp, camera)[0]", "how many metres"),
]
WRONG_ANSWERS["6.2"] = [
    (_CLIMB.format(else_branch=""), "40% of the pixels"),
    (_CLIMB.format(else_branch="else: column -= step"), "with its sign"),
    ("climb_and_coast = lambda binary, column: np.argwhere(binary)", "(column, row)"),
    ("climb_and_coast = lambda binary, column: np.argwhere(binary)[:, ::-1]", "another line"),
]

WRONG_ANSWERS["7.1"] = [
    ("ransac_choice = 29", "two whole numbers"),
    ("ransac_choice = 2, 18", "three coefficients"),
    ("ransac_choice = 3, 105", "not 0.4 to the power of 3"),
    ("ransac_choice = 3, 28", "99.89%. Required are 99.90%"),
    ("ransac_choice = 3, 30", "not the smallest number"),
    ("ransac_choice = 3, 5", "at least one of 5 samples"),
    ("ransac_choice = 150, 40", "is clean with the probability 0.0%"),
]
WRONG_ANSWERS["7.2"] = [
    ("corrected = 888", "three numbers"),
    ("corrected = 724, 1614, 0.170", "s_v squared over s_u"),
    ("f = 0.0430 / (30 / 720) / (0.00459 / (3.7 / 700)); corrected = 724 * f, 1614 * f, 0.170", "counts squared"),
    ("f = 0.8154; corrected = 724 * f, 1614 * f, 0.170", "upside down"),
    ("corrected = 724 * 1.065, 1614 * 1.065, 0.170", "depends on both scales"),
    ("corrected = 888, 1979, 0.170", "one scale, once"),
    ("corrected = 888, 1979, np.nan", "NaN"),
]

_ENDS = "ends_m = np.array([[7, np.polyval(left_road, 7)], [7, np.polyval(right_road, 7)]]); "
WRONG_ANSWERS["8.1"] = [
    ("bar_px = 500", "two points"),
    (_ENDS + "bar_px = camera.undistort_points(camera.road_to_pixels(ends_m))", "forgot the lens"),
    (_ENDS + "bar_px = camera.road_to_pixels(ends_m)[:, ::-1]", "(row, column)"),
    (_ENDS + "bar_px = camera.road_to_pixels(ends_m)[::-1]", "exchanged"),
    (_ENDS + "bar_px = camera.road_to_pixels(ends_m * [1, -1])", "sign of y"),
    (_ENDS + "bar_px = camera.road_to_pixels(ends_m[:, ::-1] * [1, 7])", "NaN"),
    (_ENDS + "bar_px = pose_warp.points_to_birdseye(camera.road_to_pixels(ends_m))", "px off"),
]

_ERROR = """
def pitch_error_deg(seen_width_m, distance_m, height_m, true_width_m):
    return {}
"""
WRONG_ANSWERS["9.1"] = [
    (_ERROR.format("height_m / distance_m * (1 - seen_width_m / true_width_m)"), "in radians"),
    (_ERROR.format("np.degrees(height_m / distance_m * (seen_width_m / true_width_m - 1))"), "the sign is wrong"),
    (_ERROR.format("np.degrees(height_m / distance_m * (true_width_m / seen_width_m - 1))"), "distance in the view"),
    (_ERROR.format("np.degrees(height_m / distance_m * (1 - true_width_m / seen_width_m))"), "upside down"),
    (_ERROR.format("np.degrees((1 - seen_width_m / true_width_m) / distance_m)"), "the height is missing"),
    (_ERROR.format("np.degrees(np.arctan(height_m / distance_m))"), "Compare the two"),
    (_ERROR.format("distance_m, height_m"), "return one number"),
]

_FILTER = """
def stripe_response(row, width):
    mean = lambda values, count: np.convolve(values, np.ones(count) / count, mode="same")
    centre, road, reach = mean(row, width), mean(row, 3), width // 2 + 3
    left, right = np.roll(road, reach), np.roll(road, -reach)
    noise = 1 + mean(np.abs(np.diff(row, prepend=row[0])), 51)
    return {}
"""
_RESPONSE = "(centre - np.maximum(left, right)) / noise"
WRONG_ANSWERS["10.1"] = [
    (_FILTER.format("(centre - (left + right) / 2) / noise"), "the larger of the two sides"),
    (_FILTER.format("(centre - left) / noise"), "the larger of the two sides"),
    (_FILTER.format("np.abs(centre - np.maximum(left, right)) / noise"), "a dark seam scores"),
    (_FILTER.format("(np.maximum(left, right) - centre) / noise"), "Subtract the road from the stripe"),
    (_FILTER.format("centre - np.maximum(left, right)"), "Divide by the noise"),
    (_FILTER.format("(centre - np.maximum(left, right)) / (noise - 1)"), "Divide by the noise, 1 + n"),
    (_FILTER.replace("51", "5").format(_RESPONSE), "mean over 51 cells"),
    (_FILTER.replace("width // 2 + 3", "4").format(_RESPONSE), "double line"),
    (_FILTER.replace("width // 2 + 3", "width // 2 + 2").format(_RESPONSE), "Check gap"),
    (_FILTER.format("(centre - np.maximum(left, right)) / (noise * np.nan)"), "NaN or infinite"),
    (_FILTER.format("np.max(centre - np.maximum(left, right)) / noise[:5]"), "one number for each cell"),
]

_FIT = """
def fit_known_width(x_m, y_m, left, width_m):
    design = np.column_stack([np.ones_like(x_m), x_m, x_m**2 / 2])
    return np.linalg.lstsq(design, {}, rcond=None)[0]
"""
_CENTRE = "y_m - np.where(left, 1, -1) * width_m / 2"
WRONG_ANSWERS["11.1"] = [
    (_FIT.format("y_m"), "this is the line"),
    (_FIT.format("y_m - np.where(left, 1, -1) * width_m"), "half a width from either line"),
    (_FIT.format("y_m + np.where(left, 1, -1) * width_m / 2"), "wrong side of the left line"),
    (_FIT.format("y_m - width_m / 2"), "not with the right line"),
    (_FIT.format("y_m - np.where(left, 1, -1) * 3.66 / 2"), "Use width_m and left"),
    (_FIT.replace("[0]\n", "[0] * np.nan\n").format(_CENTRE), "true are 0.25 m"),
    (_FIT.replace("x_m**2 / 2", "x_m**2").format(_CENTRE), "use x^2 / 2"),
    (_FIT.replace("np.ones_like(x_m), x_m, x_m**2 / 2", "left, ~left, x_m, x_m**2 / 2").format("y_m"), "shape (4,)"),
]

_STEP = """
def correct_gated(state, P, z, R, H):
    innovation, S = z - H @ state, H @ P @ H.T + R
    if innovation @ np.linalg.solve(S, innovation) > 11.3:
        return state, P
    K = P @ H.T @ np.linalg.inv(S)
    return state + K @ innovation, P - K @ H @ P
"""
WRONG_ANSWERS["12.1"] = [
    (_STEP.replace("H @ P @ H.T + R", "H @ P @ H + R"), "H is not square"),
    (_STEP.replace("P - K @ H @ P", "P"), "P is not updated"),
    (_STEP.replace("P - K @ H @ P", "P + K @ H @ P"), "is not P - K H P"),
    (_STEP.replace("z - H @ state", "H @ state - z"), "state + K (z - H state)"),
    (_STEP.replace("> 11.3", "> 1e9"), "is accepted"),
    (_STEP.replace("> 11.3", "> 11.3**2"), "not its root"),
    (_STEP.replace("solve(S, innovation)", "solve(R, innovation)"), "not R alone"),
    (_STEP.replace("solve(S, innovation)", "solve(np.diag(np.diag(S)), innovation)"), "the diagonal of S"),
    (_STEP.replace("return state, P\n", "return None\n"), "None is returned"),
    (_STEP.replace("return state, P\n", "return state, 2 * P\n"), "must leave P as it is"),
]

_FAILURE = """
def first_failure(image, camera):
    for degrees in range(60):
        pose = replace(camera.pose, pitch_rad=camera.pose.pitch_rad + np.radians(degrees))
        failed = helpers.explain(image, camera.with_pose(pose)).failed
        if failed:
            return degrees, failed.name
"""
WRONG_ANSWERS["13.1"] = [
    (_FAILURE.replace("np.radians(degrees)", "degrees"), "pitch_rad is in radians"),
    (_FAILURE.replace("+ np.radians", "- np.radians"), "you turned the camera up"),
    (_FAILURE.replace("degrees, failed.name", "degrees - 1, failed.name"), "no step fails yet"),
    (_FAILURE.replace("failed.name", "failed"), "take `.failed.name`"),
    (_FAILURE.replace("failed.name", "failed.failure"), "take `.failed.name`"),
    (_FAILURE.replace("degrees, failed.name", "degrees"), "return two values"),
    (_FAILURE.replace("range(60)", "range(0, 60, 5)"), "in turn"),
]

_SHARE = """
def share_right(confidence, right, low, high):
    group = (confidence >= low) & (confidence < high)
    return right[group].mean() if group.any() else np.nan
"""
WRONG_ANSWERS["14.1"] = [
    (_SHARE.replace("right[group].mean()", "(right & group).mean()"), "a share of all frames"),
    (_SHARE.replace("right[group].mean()", "group[right].mean()"), "a share of the right frames"),
    (_SHARE.replace("right[group].mean()", "right[group].sum()"), "the number of right frames"),
    (_SHARE.replace("right[group].mean()", "confidence[group].mean()"), "the mean confidence"),
    (_SHARE.replace("right[group].mean()", "(~right[group]).mean()"), "the share of wrong frames"),
    (_SHARE.replace("< high", "<= high"), "exactly `high`"),
    (_SHARE.replace(">= low", "> low"), "exactly `low`"),
    (_SHARE.replace("np.nan", "0.0"), "return np.nan, not 0.0"),
    (_SHARE.replace("np.nan", "None"), "return np.nan, not None"),
    (_SHARE.replace("right[group].mean()", "right.mean()"), "the true share"),
    (_SHARE.replace("right[group].mean()", "right[group]"), "return one number"),
]

WRONG_ANSWERS["15.1"] = [
    ("better_finder = my_finder", "more; what do the wrong frames"),
    ("def better_finder(image, camera):\n    return [(0.0, 0.0, 640.0), (0.0, 0.0, 200.0)]", "left line first"),
    ("def better_finder(image, camera):\n    return [(0.0, 0.0, 1.8)]", "two lines or None"),
]

_GRADIENT = """
def loss_gradient(cells, is_paint, weights, bias):
    p = 1 / (1 + np.exp(-(cells @ weights + bias)))
    wrong = p - is_paint
    return {}
"""
WRONG_ANSWERS["16.1"] = [
    (_GRADIENT.format("cells.T @ -wrong / len(cells), -wrong.mean()"), "points downhill"),
    (_GRADIENT.format("cells.T @ wrong, wrong.sum()"), "mean over the examples"),
    (_GRADIENT.format("cells.T @ (wrong * p * (1 - p)) / len(cells), wrong.mean()"), "cancel"),
    (_GRADIENT.format("cells.T @ wrong / len(cells), 0.0"), "Its input is always 1"),
    (_GRADIENT.format("cells.T @ wrong * np.nan, wrong.mean()"), "off by up to nan"),
    (_GRADIENT.format("cells * wrong[:, None], wrong"), "the shapes are"),
    (_GRADIENT.format("wrong.mean()"), "return two things"),
]
