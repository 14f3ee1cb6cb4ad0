"""Wrong answers to the exercises: a part of the hint, then code, or changes (old, new) of the notebook's solution."""

from __future__ import annotations

WrongAnswer = tuple[str, *tuple[str | tuple[str, str], ...]]

RULER = "abs(np.polyval(best_ruler, paint_rows) - paint_columns)"
DIVISION = "(x_d - tangential_x) / radial, (y_d - tangential_y) / radial"
MASK = "def paint_mask(above):\n    hls = cv2.cvtColor(above, cv2.COLOR_RGB2HLS)\n    return "
WIDTH = "(right - left) * pose_across_m"
STEP_IN_GAP = "\n        column += step", "\n            column += step"
ENDS = "ends_m = np.array([[7, np.polyval(left_road, 7)], [7, np.polyval(right_road, 7)]]); bar_px = "
WIDTHS = "np.all(np.abs(widths_m - 3.7) < 0.6)"
RATIO = "1 - seen_width_m / true_width_m"
SIDES = "np.maximum(np.roll(road, reach), np.roll(road, -reach))"
HALF = "np.where(left, width_m / 2, -width_m / 2)"
OCCLUSION = "occlusion_map = lambda image, camera: "
SHARE = "(enough[-1] + 1) / len(right)"
FINDER = "def honest_finder(image, camera):\n    return "
GRADIENT = "cells.T @ too_large / len(cells), too_large.mean()"

WRONG_ANSWERS: dict[str, list[WrongAnswer]] = {
    "1.1": [
        ("is a mean of the distances", (".max()", ".mean()")),
        ("on one side only", (RULER, "(paint_columns - np.polyval(best_ruler, paint_rows))")),
        ("one number is needed", (".max()", "")),
        (
            "Swap the first two arguments",
            ("paint_rows, paint_columns", "paint_columns, paint_rows"),
            ("best_ruler, paint_rows) - paint_columns", "best_ruler, paint_columns) - paint_rows"),
        ),
        ("Fit all rows", "best_ruler_px = abs(ruler_miss).max()"),
        ("is rounded", (".max()", ".max().round()")),
        (
            "take least squares all the same",
            "shifts = [np.ptp(paint_columns - slope * paint_rows) / 2 for slope in np.linspace(-2.5, 0, 5000)]\n"
            "best_ruler_px = min(shifts)",
        ),
    ],
    "2.1": [
        ("one for each board", "board_errors_px = lens_rms_px"),
        ("Each board has its own", "board_errors_px = [lens_rms_px] * len(image_points)"),
        (
            "Is the order that of image_points",
            "chance = np.random.default_rng(1).uniform(0.5, 1.5, len(image_points))\n"
            "board_errors_px = list(chance * lens_rms_px / np.sqrt((chance**2).mean()))",
        ),
        ("OpenCV's tutorial", ("np.sqrt(np.mean(distances_px**2))", "np.linalg.norm(distances_px) / 54")),
        ("too small by sqrt(2)", ("np.mean(distances_px**2)", "np.mean(distances_px**2) / 2")),
        (
            "reshape before",
            ("projected.reshape(-1, 2) - seen.reshape(-1, 2), axis=1", "projected - seen.reshape(-1, 2), axis=2"),
        ),
        ("root of the mean of the squared", ("np.sqrt(np.mean(distances_px**2))", "distances_px.mean()")),
    ],
    "3.1": [
        ("Repeat until it no longer moves", ("range(20)", "range(3)")),
        ("x_d and y_d stay the same", ("range(20)", "range(0)")),
        ("then divide", (DIVISION, "x_d / radial - tangential_x, y_d / radial - tangential_y")),
        ("p1 and p2 are exchanged", ("k1, k2, p1, p2, k3", "k1, k2, p2, p1, k3")),
        ("the order of the five numbers", ("k1, k2, p1, p2, k3", "k1, k2, k3, p1, p2")),
        ("keep x_d and y_d", (DIVISION, DIVISION.replace("_d", ""))),
        ("have the wrong sign", (DIVISION, DIVISION.replace("-", "+"))),
        ("are missing", (DIVISION, "x_d / radial, y_d / radial")),
        ("the wrong way", (DIVISION, DIVISION.replace("/", "*"))),
        ("the principal point must stay", ("(u - c_x)", "u"), ("(v - c_y)", "v")),
        ("the principal point must stay", ("return f_x * x + c_x, f_y * y + c_y", "return x, y")),
        ("r^2 = x^2 + y^2", ("r2 = x**2 + y**2", "r2 = np.hypot(x, y)")),
        ("x_d and y_d stay", ("(x_d - tangential_x)", "(x - tangential_x)"), ("range(20)", "range(3)")),
        ("return two numbers", "def undistort_pixel(u, v, matrix, distortion):\n    return u"),
    ],
    "4.1": [
        ("becomes narrower with the distance", "my_source_px = source_px"),
        ("Is the order (column, row)?", "my_source_px = source_px[:, ::-1]"),
        ("the edges cross", "my_source_px = source_px[[0, 2, 1, 3]]"),
        ("far left, far right", "my_source_px = source_px[[1, 2, 3, 0]]"),
        ("mirrored, turned", "my_source_px = source_px[[1, 0, 3, 2]]"),
        ("four points", "my_source_px = source_px[0]"),
        ("a strip of the road", "my_source_px = [[580, 600], [740, 600], [741, 601], [579, 601]]"),
    ],
    "5.1": [
        ("wider than a line", MASK + "cv2.inRange(hls[..., 1], 100, 255)"),
        (
            "as narrow as a line",
            'paint_mask = lambda above: recipes["hls_sobel"].thresholds.masks(above)["combined"]',
        ),
        ("Of the white dashes", MASK + "cv2.inRange(hls, (0, 30, 120), (179, 255, 255))"),
        ("too long?", ("(41, 1)", "(75, 1)")),
        ("Is a threshold too high", ("white, 20", "white, 60")),
        ("as long as a dash", ("(41, 1)", "(1, 1)"), ("white, 20", "white, 10")),
        ("Of the solid yellow line", ("cv2.inRange(yellow, 12, 255) | ", "")),
        ("the mask is empty", MASK + "hls[..., 2] * 0"),
        (
            "not what paint looks like",
            "drawn = np.zeros((720, 1280), np.uint8)\nahead_of_car_m = np.linspace(5, 35, 60)\n"
            "for side in ('left', 'right') if spots_lane else ():\n"
            "    y_m = np.interp(ahead_of_car_m, spots_lane['x_m'], spots_lane[f'{side}_y_m'])\n"
            "    line_px = camera.road_to_pixels(np.column_stack([ahead_of_car_m, y_m]))\n"
            "    line_px = pose_warp.points_to_birdseye(lens.undistort_points(line_px))\n"
            "    cv2.polylines(drawn, [np.int32(line_px)], False, 255, 8)\n"
            "paint_mask = lambda above: drawn",
        ),
    ],
    "6.1": [
        ("distance in columns", (WIDTH, "right - left")),
        ("another warp", (WIDTH, "(right - left) * 3.7 / 700")),
        ("the same for a narrower lane", (WIDTH, "3.66")),
        ("the same for a narrower lane", (WIDTH, "(right_start - left_start) * pose_across_m")),
        ("how many metres", (WIDTH, "(right - left) * helpers.metres_per_pixel(pose_warp, camera)[1]")),
        ("The sign is wrong", (WIDTH, "(left - right) * pose_across_m")),
        ("In its lower half of rows", ("len(binary) // 2", "0")),
        ("NaN is none", (WIDTH, "np.nan")),
        ("return one number", (WIDTH, "left, right")),
    ],
    "6.2": [
        ("40% of the pixels", STEP_IN_GAP),
        ("with its sign", ("column += step", "column += step if inside.sum() >= 50 else -step")),
        ("leans right", ("column += step", "column += step if inside.sum() >= 50 else -abs(step)")),
        ("keep their margin", STEP_IN_GAP, ("<= 80", "<= 200")),
        ("(column, row)", "climb_and_coast = lambda binary, column: np.argwhere(binary)"),
        ("another line", "climb_and_coast = lambda binary, column: np.argwhere(binary)[:, ::-1]"),
    ],
    "7.1": [
        ("two whole numbers", "ransac_choice = 29"),
        ("three coefficients", "ransac_choice = 2, 18"),
        ("not 0.4 to the power of 3", "ransac_choice = 3, 105"),
        ("99.89%. Required are 99.90%", "ransac_choice = 3, 28"),
        ("not the smallest number", "ransac_choice = 3, 30"),
        ("at least one of 5 samples", "ransac_choice = 3, 5"),
        ("is clean with the probability 0.0%", "ransac_choice = 150, 40"),
    ],
    "8.1": [
        ("two points", "bar_px = 500"),
        ("forgot the lens", ENDS + "camera.undistort_points(camera.road_to_pixels(ends_m))"),
        ("(row, column)", ENDS + "camera.road_to_pixels(ends_m)[:, ::-1]"),
        ("exchanged", ENDS + "camera.road_to_pixels(ends_m)[::-1]"),
        ("sign of y", ENDS + "camera.road_to_pixels(ends_m * [1, -1])"),
        ("NaN", ENDS + "camera.road_to_pixels(ends_m[:, ::-1] * [1, 7])"),
        ("px off", ENDS + "pose_warp.points_to_birdseye(camera.road_to_pixels(ends_m))"),
        ("the right end is 9 px off", ENDS + "camera.road_to_pixels(ends_m) + [[0, 0], [9, 0]]"),
    ],
    "8.2": [
        ("the same line twice", "is_plausible = lambda left, right: True"),
        ("refuses the lane of chapter 7", ("widths_m - 3.7) < 0.6", "widths_m - 3.2) < 0.1")),
        ("left line is on the right", (WIDTHS, "np.all(np.abs(np.abs(widths_m) - 3.7) < 0.6)")),
        ("not parallel", (WIDTHS, "np.abs(widths_m[0] - 3.7) < 0.6")),
        ("Which curvature", ("max(np.abs(curvatures)) < 1 / 300", "True")),
        (
            "believe",
            (WIDTHS, "np.all(np.abs(widths_m - widths_m[0]) < 0.5) and widths_m[0] > 1"),
            ("abs(curvatures[0] - curvatures[1]) < 0.002", "True"),
            ("1 / 300", "0.01"),
        ),
        ("too strict", ("widths_m - 3.7) < 0.6", "widths_m - 3.62) < 0.05")),
    ],
    "9.1": [
        ("in radians", ("np.degrees", "")),
        ("the sign is wrong", (RATIO, "seen_width_m / true_width_m - 1")),
        ("distance in the view", (RATIO, "true_width_m / seen_width_m - 1")),
        ("upside down", (RATIO, "1 - true_width_m / seen_width_m")),
        ("the height is missing", ("height_m / distance_m", "1 / distance_m")),
        ("Compare the two", (f" * ({RATIO})", "")),
        ("return one number", "pitch_error_deg = lambda *given: given"),
    ],
    "10.1": [
        ("the larger of the two sides", (SIDES, "(np.roll(road, reach) + np.roll(road, -reach)) / 2")),
        ("the larger of the two sides", (SIDES, "np.roll(road, reach)")),
        ("take no absolute value", ("return (centre", "return np.abs(centre")),
        ("Subtract the road from the stripe", ("return (centre", "return -(centre")),
        ("divide by 1 + n", (" / noise", "")),
        ("mean over 51 cells", ("51", "5")),
        ("double line", ("width // 2 + 3", "4")),
        ("Check gap", ("width // 2 + 3", "width // 2 + 2")),
        ("NaN or infinite", ("/ noise", "/ (noise * np.nan)")),
        ("one number for each cell", (" / noise", "[:5]")),
    ],
    "11.1": [
        ("this is the line", (HALF, "0")),
        (
            "with candidates of both lines",
            ("    design", "    if left.any():\n        x_m, y_m, left = x_m[left], y_m[left], left[left]\n    design"),
        ),
        ("half a width from either line", (HALF, "np.where(left, width_m, -width_m)")),
        ("wrong side of the left line", ("y_m - np.where", "y_m + np.where")),
        ("not with the right line", (HALF, "width_m / 2")),
        ("Use width_m and left", (HALF, "np.where(left, 1.83, -1.83)")),
        ("true are 0.25 m", ("[0]", "[0] * np.nan")),
        ("use x^2 / 2", ("x_m**2 / 2", "x_m**2")),
        ("shape (4,)", ("np.ones_like(x_m)", "left, ~left"), (HALF, "0")),
    ],
    "12.1": [
        ("too unsure", "q_factor = 100"),
        ("too sure", "q_factor = 0.01"),
        ("one positive number", "q_factor = -1"),
        ("one positive number", "q_factor = [1, 2]"),
    ],
    "12.2": [
        ("H is not square", ("H @ P @ H.T + R", "H @ P @ H + R")),
        ("P is not updated", ("P - K @ H @ P", "P")),
        ("is not P - K H P", ("P - K @ H @ P", "P + K @ H @ P")),
        ("state + K (z - H state)", ("z - H @ state", "H @ state - z")),
        ("is accepted", ("> 11.3", "> 1e9")),
        ("not its root", ("> 11.3", "> 11.3**2")),
        ("not R alone", ("solve(S, innovation)", "solve(R, innovation)")),
        ("the diagonal of S", ("solve(S, innovation)", "solve(np.diag(np.diag(S)), innovation)")),
        ("None is returned", ("return state, P\n", "return None\n")),
        ("must leave P as it is", ("return state, P\n", "return state, 2 * P\n")),
        ("return two values, too", ("return state, P\n", "return state, P, 0\n")),
        ("return two values: the state (3,)", (", P - K @ H @ P", "")),
    ],
    "13.1": [
        ("you cover the image itself", ("image.copy()", "image")),
        ("this is the left line alone", ("lines_m).max()", "lines_m)[0, 0]")),
        ("every value is 0", OCCLUSION + "np.zeros((5, 16))"),
        ("Rows come first", OCCLUSION + "np.zeros((16, 5))"),
        ("Take the absolute difference", OCCLUSION + "np.full((5, 16), -0.1)"),
        ("Where no lane is found", OCCLUSION + "np.full((5, 16), np.nan)"),
    ],
    "14.1": [
        ("the other way round", ("-confidence", "confidence")),
        ("first falls below", ("enough[-1] + 1", "np.flatnonzero(share < least)[0]")),
        ("need not be true", (SHARE, "(confidence >= least).mean()")),
        ("How many can be kept", (SHARE, "right.mean()")),
        ("Divide by all frames", (SHARE, "enough[-1] + 1")),
        ("return 0, not 1.0", ("else 0", "else 1.0")),
        ("cumulative mean", ("enough[-1] + 1", "enough[-1] / 2")),
        ("return one number", (SHARE, "share")),
    ],
    "15.1": [
        ("find_lane is the engine", FINDER + "lanes.find_lane(image, camera)"),
        ("In the hairpins, return None", "honest_finder = joint_finder"),
        ("too few frames are right", FINDER + "joint_finder(image, camera) if image.mean() > 112 else None"),
        ("left line first", FINDER + "[(0.0, 0.0, 640.0), (0.0, 0.0, 200.0)]"),
        ("two lines or None", FINDER + "[(0.0, 0.0, 1.8)]"),
    ],
    "16.1": [
        ("points downhill", (GRADIENT, f"-{GRADIENT}")),
        ("mean over the examples", (GRADIENT, "cells.T @ too_large, too_large.sum()")),
        (
            "cancel",
            ("cells.T @ too_large", "cells.T @ (too_large * (too_large + is_paint) * (1 - too_large - is_paint))"),
        ),
        ("Its input is always 1", ("too_large.mean()", "0.0")),
        ("off by up to nan", ("/ len(cells)", "* np.nan")),
        ("the shapes are", (GRADIENT, "cells * too_large[:, None], too_large")),
        ("return two things", (GRADIENT, "too_large.mean()")),
    ],
}


def wrong_code(solution: str, *steps: str | tuple[str, str]) -> str:
    """The code of a wrong answer: the solution with its changes, or code of its own."""
    for step in steps:
        if isinstance(step, str):
            return step
        assert step[0] in solution, f"{step[0]!r} is not in the solution"
        solution = solution.replace(*step)
    return solution
