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
    (_ERRORS + "best_ruler_px = round(abs(errors).max())", "is rounded"),
    (
        "shifts = [np.ptp(paint_columns - slope * paint_rows) / 2 for slope in np.linspace(-2.5, 0, 5000)]\n"
        "best_ruler_px = min(shifts)",
        "take least squares all the same",
    ),
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
    (
        "chance = np.random.default_rng(1).uniform(0.5, 1.5, len(image_points))\n"
        "board_errors_px = list(chance * lens_rms_px / np.sqrt((chance**2).mean()))",
        "Is the order that of image_points",
    ),
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
    (_UNDISTORT.replace("r2 = x**2 + y**2", "r2 = np.hypot(x, y)"), "r^2 = x^2 + y^2"),
    (_UNDISTORT.replace("(x_d - shift_x)", "(x - shift_x)").replace("range(20)", "range(3)"), "x_d and y_d stay"),
    ("def undistort_pixel(u, v, matrix, distortion):\n    return u", "return two numbers"),
]

WRONG_ANSWERS["4.1"] = [
    ("my_source_px = source_px", "becomes narrower with the distance"),
    ("my_source_px = source_px[:, ::-1]", "Is the order (column, row)?"),
    ("my_source_px = source_px[[0, 2, 1, 3]]", "the edges cross"),
    ("my_source_px = source_px[[1, 2, 3, 0]]", "far left, far right"),
    ("my_source_px = source_px[[1, 0, 3, 2]]", "mirrored, turned"),
    ("my_source_px = source_px[0]", "four points"),
    ("my_source_px = [[580, 600], [740, 600], [741, 601], [579, 601]]", "a strip of the road"),
]
_MASK = "def paint_mask(above):\n    hls = cv2.cvtColor(above, cv2.COLOR_RGB2HLS)\n    return "
_TOP_HAT = """
def paint_mask(above):
    channels = above[..., 2].copy(), cv2.cvtColor(above, cv2.COLOR_RGB2LAB)[..., 2].copy()
    white, yellow = (cv2.morphologyEx(c, cv2.MORPH_TOPHAT, np.ones((1, 61), np.uint8)) for c in channels)
    white = cv2.morphologyEx(white, cv2.MORPH_OPEN, np.ones(({rows}, 1), np.uint8))
    white, yellow = cv2.inRange(white, {level}, 255), cv2.inRange(yellow, 12, 255)
    return yellow | white
"""
WRONG_ANSWERS["5.1"] = [
    (_MASK + "cv2.inRange(hls[..., 1], 100, 255)", "wider than a line"),
    ('paint_mask = lambda above: recipes["hls_sobel"].thresholds.masks(above)["combined"]', "as narrow as a line"),
    (_MASK + "cv2.inRange(hls, (0, 30, 120), (179, 255, 255))", "Of the white dashes"),
    (_TOP_HAT.format(rows=75, level=20), "too long?"),
    (_TOP_HAT.format(rows=41, level=60), "Is a threshold too high"),
    (_TOP_HAT.format(rows=1, level=10), "as long as a dash"),
    (_TOP_HAT.format(rows=41, level=20).replace("yellow |", ""), "Of the solid yellow line"),
    (_MASK + "hls[..., 2] * 0", "the mask is empty"),
    (
        "drawn = np.zeros((720, 1280), np.uint8)\nahead_of_car_m = np.linspace(5, 35, 60)\n"
        "for side in ('left', 'right') if spots_lane else ():\n"
        "    y_m = np.interp(ahead_of_car_m, spots_lane['x_m'], spots_lane[f'{side}_y_m'])\n"
        "    line_px = camera.road_to_pixels(np.column_stack([ahead_of_car_m, y_m]))\n"
        "    line_px = pose_warp.points_to_birdseye(lens.undistort_points(line_px))\n"
        "    cv2.polylines(drawn, [np.int32(line_px)], False, 255, 8)\n"
        "paint_mask = lambda above: drawn",
        "not what paint looks like",
    ),
]

_WIDTH = """
def lane_width(binary):
    left, right = helpers.find_peaks(np.count_nonzero(binary[len(binary) // 2 :], axis=0))
    across_m, along_m = helpers.metres_per_pixel(pose_warp, camera)
    return {}
"""
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
    (_WIDTH.format("right - left"), "distance in columns"),
    (_WIDTH.format("(right - left) * 3.7 / 700"), "another warp"),
    (_WIDTH.format("3.66"), "the same for a narrower lane"),
    (_WIDTH.format("(right_start - left_start) * across_m"), "the same for a narrower lane"),
    (_WIDTH.format("(right - left) * along_m"), "how many metres"),
    (_WIDTH.format("(left - right) * across_m"), "The sign is wrong"),
    (_WIDTH.replace("len(binary) // 2", "0").format("(right - left) * across_m"), "In its lower half of rows"),
    (_WIDTH.format("np.nan"), "NaN is none"),
    (_WIDTH.format("left * across_m, right * across_m"), "return one number"),
]
WRONG_ANSWERS["6.2"] = [
    (_CLIMB.format(else_branch=""), "40% of the pixels"),
    (_CLIMB.format(else_branch="else: column -= step"), "with its sign"),
    (_CLIMB.format(else_branch="else: column -= abs(step)"), "leans right"),
    (_CLIMB.replace("<= 80)", "<= 200)").format(else_branch=""), "keep their margin"),
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

_ENDS = "ends_m = np.array([[7, np.polyval(left_road, 7)], [7, np.polyval(right_road, 7)]]); "
WRONG_ANSWERS["8.1"] = [
    ("bar_px = 500", "two points"),
    (_ENDS + "bar_px = camera.undistort_points(camera.road_to_pixels(ends_m))", "forgot the lens"),
    (_ENDS + "bar_px = camera.road_to_pixels(ends_m)[:, ::-1]", "(row, column)"),
    (_ENDS + "bar_px = camera.road_to_pixels(ends_m)[::-1]", "exchanged"),
    (_ENDS + "bar_px = camera.road_to_pixels(ends_m * [1, -1])", "sign of y"),
    (_ENDS + "bar_px = camera.road_to_pixels(ends_m[:, ::-1] * [1, 7])", "NaN"),
    (_ENDS + "bar_px = pose_warp.points_to_birdseye(camera.road_to_pixels(ends_m))", "px off"),
    (_ENDS + "bar_px = camera.road_to_pixels(ends_m) + [[0, 0], [9, 0]]", "the right end is 9 px off"),
]

_SANE = """
def is_plausible(left, right):
    left, right = line_on_road(left), line_on_road(right)
    widths_m, bends = np.polyval(left - right, [7, 15, 25]), np.abs([2 * left[0], 2 * right[0]])
    return {}
"""
_WIDE, _ALIKE = "np.all(np.abs(widths_m - 3.7) < 0.6)", "np.ptp(bends) < 0.002"
WRONG_ANSWERS["8.2"] = [
    (_SANE.format("True"), "the same line twice"),
    (_SANE.format(f"np.all(np.abs(widths_m - 3.2) < 0.1) and {_ALIKE}"), "refuses the lane of chapter 7"),
    (_SANE.format(f"np.all(np.abs(np.abs(widths_m) - 3.7) < 0.6) and {_ALIKE}"), "left line is on the right"),
    (_SANE.format("np.abs(widths_m[0] - 3.7) < 0.6"), "not parallel"),
    (_SANE.format(f"{_WIDE} and {_ALIKE}"), "Which curvature"),
    (_SANE.format("np.all(np.abs(widths_m - widths_m[0]) < 0.5) and widths_m[0] > 1 and max(bends) < 0.01"), "believe"),
    (_SANE.format("np.all(np.abs(widths_m - 3.62) < 0.05) and max(bends) < 0.01"), "too strict"),
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
    (_FILTER.format("np.abs(centre - np.maximum(left, right)) / noise"), "take no absolute value"),
    (_FILTER.format("(np.maximum(left, right) - centre) / noise"), "Subtract the road from the stripe"),
    (_FILTER.format("centre - np.maximum(left, right)"), "divide by 1 + n"),
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
    (
        _FIT.replace(
            "design =", "if left.any():\n        x_m, y_m, left = x_m[left], y_m[left], left[left]\n    design ="
        ).format(_CENTRE),
        "with candidates of both lines",
    ),
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
    ("q_factor = 100", "too unsure"),
    ("q_factor = 0.01", "too sure"),
    ("q_factor = -1", "one positive number"),
    ("q_factor = [1, 2]", "one positive number"),
]
WRONG_ANSWERS["12.2"] = [
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
    (_STEP.replace("return state, P\n", "return state, P, 0\n"), "return two values, too"),
    (_STEP.replace(", P - K @ H @ P", ""), "return two values: the state (3,)"),
]

_OCCLUSION = """
def occlusion_map(image, camera):
    at_m, moved_m = np.array([20.0]), np.zeros((5, 16))
    lines_m = lanes.find_lane(image, camera).lateral_m(at_m)
    for row, column in np.ndindex(5, 16):
        covered = image.copy()
        covered[320 + 80 * row : 400 + 80 * row, 80 * column : 80 * column + 80] = 128
        lane = lanes.find_lane(covered, camera)
        moved_m[row, column] = 1 if lane is None else min(1, np.abs(lane.lateral_m(at_m) - lines_m).max())
    return moved_m
"""
_MAP = "occlusion_map = lambda image, camera: "
WRONG_ANSWERS["13.1"] = [
    (_OCCLUSION.replace("image.copy()", "image"), "you cover the image itself"),
    (_OCCLUSION.replace("lines_m).max()", "lines_m)[0, 0]"), "this is the left line alone"),
    (_MAP + "np.zeros((5, 16))", "every value is 0"),
    (_MAP + "np.zeros((16, 5))", "Rows come first"),
    (_MAP + "np.full((5, 16), -0.1)", "Take the absolute difference"),
    (_MAP + "np.full((5, 16), np.nan)", "Where no lane is found"),
]

_KEEP = """
def largest_share(confidence, right, least):
    share = np.cumsum(right[np.argsort(-confidence)]) / np.arange(1, len(right) + 1)
    enough = np.flatnonzero(share >= least)
    return (enough[-1] + 1) / len(right) if len(enough) else 0
"""
WRONG_ANSWERS["14.1"] = [
    (_KEEP.replace("-confidence", "confidence"), "the other way round"),
    (_KEEP.replace("enough[-1] + 1", "np.flatnonzero(share < least)[0]"), "first falls below"),
    (_KEEP.replace("(enough[-1] + 1) / len(right)", "(confidence >= least).mean()"), "need not be true"),
    (_KEEP.replace("(enough[-1] + 1) / len(right)", "right.mean()"), "How many can be kept"),
    (_KEEP.replace("(enough[-1] + 1) / len(right)", "enough[-1] + 1"), "Divide by all frames"),
    (_KEEP.replace("else 0", "else 1.0"), "return 0, not 1.0"),
    (_KEEP.replace("enough[-1] + 1", "enough[-1] / 2"), "cumulative mean"),
    (_KEEP.replace("(enough[-1] + 1) / len(right)", "share"), "return one number"),
]

_HONEST = "def honest_finder(image, camera):\n    return "
WRONG_ANSWERS["15.1"] = [
    (_HONEST + "lanes.find_lane(image, camera)", "find_lane is the engine"),
    ("honest_finder = joint_finder", "In the hairpins, return None"),
    (_HONEST + "joint_finder(image, camera) if image.mean() > 112 else None", "too few frames are right"),
    (_HONEST + "[(0.0, 0.0, 640.0), (0.0, 0.0, 200.0)]", "left line first"),
    (_HONEST + "[(0.0, 0.0, 1.8)]", "two lines or None"),
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
