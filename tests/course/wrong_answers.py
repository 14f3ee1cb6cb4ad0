"""The usual wrong answers to the exercises: a part of the hint, then code, or changes
(old, new) of the solution.

`tests/course/test_exercises.py` tests how the numbers of an answer are compared with
those of the listed mistakes, and the hints whose answers take long.
"""

from __future__ import annotations

WrongAnswer = tuple[str, *tuple[str | tuple[str, str], ...]]

RETURNED = "return f_x * x + c_x, f_y * y + c_y"
MASK = "def paint_mask(above):\n    hls = cv2.cvtColor(above, cv2.COLOR_RGB2HLS)\n    return "
WIDTH = "(right - left) * pose_across_m"
STEP_IN_GAP = "\n        column += step", "\n            column += step"
WIDTHS = "np.all(np.abs(widths_m - 3.7) < 0.6)"
PARALLEL = "\n        and abs(left_curvature - right_curvature) < 0.002"
SHARPEST = "\n        and max(abs(left_curvature), abs(right_curvature)) < 1 / 300"
HALF = "np.where(left, width_m / 2, -width_m / 2)"
GATE = """\
def correct_gated(state, P, z, R, H):
    innovation = z - H @ state
    S = H @ P @ H.T + R
    if innovation @ np.linalg.solve(S, innovation) > 11.3:
        return state, P
    K = P @ H.T @ np.linalg.inv(S)
    return state + K @ innovation, P - K @ H @ P
"""
GRADIENT = "cells.T @ too_large / len(cells), too_large.mean()"

WRONG_ANSWERS: dict[str, list[WrongAnswer]] = {
    "1.1": [
        ("is a mean of the distances", (".max()", ".mean()")),
        ("is rounded", (".max()", ".max().round()")),
        ("one number is needed", (".max()", "")),
        ("is negative", ("best_ruler_px = ", "best_ruler_px = -")),
        ("is text", 'best_ruler_px = "11.7"'),
    ],
    "2.1": [
        (
            "OpenCV's tutorial",
            ("np.sqrt(np.mean(distances_px**2))", "np.linalg.norm(distances_px) / 54"),
        ),
        (
            "Each board has its own",
            "board_errors_px = [rms_px] * len(seen_corners)",
        ),
        (
            "root of the mean of the squared",
            ("np.sqrt(np.mean(distances_px**2))", "distances_px.mean()"),
        ),
        (
            "is text",
            ("np.sqrt(np.mean(distances_px**2))", "str(distances_px.mean())"),
        ),
        ("one for each board", 'board_errors_px = "0.1"'),
    ],
    "3.1": [
        ("Repeat until it no longer moves", ("range(20)", "range(3)")),
        ("p1 and p2 are exchanged", ("k1, k2, p1, p2, k3", "k1, k2, p2, p1, k3")),
        (
            "the wrong way",
            ("(x_d - tangential_x) / radial", "(x_d - tangential_x) * radial"),
            ("(y_d - tangential_y) / radial", "(y_d - tangential_y) * radial"),
        ),
        ("the principal point must stay", (RETURNED, "return x, y")),
        ("is not a number", (RETURNED, "return np.sqrt(-r2 - 1), np.nan")),
    ],
    "4.1": [
        ("becomes narrower with the distance", "my_source_px = source_px"),
        ("Is the order (column, row)?", "my_source_px = source_px[:, ::-1]"),
        ("the edges cross", "my_source_px = source_px[[0, 2, 1, 3]]"),
        ("mirrored, turned", "my_source_px = source_px[[1, 0, 3, 2]]"),
    ],
    "5.1": [
        ("wider than a line", MASK + "cv2.inRange(hls[..., 1], 100, 255)"),
        ("Is a threshold too high", ("white, 20", "white, 60")),
        ("Of the solid yellow line", ("cv2.inRange(yellow, 12, 255) | ", "")),
        (
            "not what paint looks like",
            (
                "def paint_mask(above):\n",
                "def paint_mask(above):\n    above = shade_above\n",
            ),
        ),
    ],
    "6.1": [
        ("another warp", (WIDTH, "(right - left) * 3.7 / 700")),
        ("the same for a narrower lane", (WIDTH, "3.66")),
        ("In its lower half of rows", ("len(binary) // 2", "0")),
    ],
    "6.2": [
        ("40% of the pixels", STEP_IN_GAP),
        ("keep their margin", STEP_IN_GAP, ("<= 80", "<= 200")),
        (
            "(column, row)",
            "climb_and_coast = lambda binary, column: np.argwhere(binary)",
        ),
    ],
    "7.1": [
        ("not 0.4 to the power of 3", "ransac_choice = 3, 105"),
        ("not the smallest number", "ransac_choice = 3, 30"),
        ("at least one of 5 samples", "ransac_choice = 3, 5"),
        ("two whole numbers", "ransac_choice = 3, 28.5"),
        ("do not determine a parabola", "ransac_choice = 2, 20"),
    ],
    "8.1": [
        (
            "forgot the lens",
            ("bar_px = through_lens(bar_flat_px)", "bar_px = bar_flat_px"),
        ),
        (
            "through the lens backwards",
            (
                "through_lens(bar_flat_px)",
                "helpers.undistort_points(bar_flat_px, lens)",
            ),
        ),
        (
            "left and right are exchanged",
            ("through_lens(bar_flat_px)", "through_lens(bar_flat_px)[::-1]"),
        ),
        (
            "(row, column)",
            ("through_lens(bar_flat_px)", "through_lens(bar_flat_px)[:, ::-1]"),
        ),
        (
            "the right end is 9 px off",
            (
                "through_lens(bar_flat_px)",
                "through_lens(bar_flat_px) + [[0, 0], [9, 0]]",
            ),
        ),
    ],
    "8.2": [
        (
            "refuses the lane of chapter 7",
            ("widths_m - 3.7) < 0.6", "widths_m - 3.2) < 0.1"),
        ),
        ("the same line twice", "is_plausible = lambda left, right: True"),
        (
            "left line is on the right",
            (WIDTHS, "np.all(np.abs(np.abs(widths_m) - 3.7) < 0.6)"),
        ),
        ("not parallel", (WIDTHS, "abs(widths_m[0] - 3.7) < 0.6"), (PARALLEL, "")),
        ("50 m radius", (SHARPEST, "")),
        (
            "too strict",
            ("widths_m - 3.7) < 0.6", "widths_m - 3.6) < 0.1"),
            ("< 0.002", "< 0.00035"),
        ),
        (
            "believe",
            (
                WIDTHS,
                "np.all(np.abs(widths_m - widths_m[0]) < 0.5) and widths_m[0] > 1",
            ),
            (PARALLEL, ""),
            ("1 / 300", "0.01"),
        ),
    ],
    "8.3": [
        ("there is no photo yet", ("my_road = ", "my_road = None and ")),
        ("no file", ('DATA.still("straight_lines1")', '"no_road.jpg"')),
        ("an array of shape (4, 2)", ("source_px", "source_px[:2]")),
        ("must be higher in the image", ("source_px", "source_px[:, ::-1]")),
        ("left and right are exchanged", ("source_px", "source_px[[1, 0, 3, 2]]")),
        ("Move the far points together", ("pose_warp", 'warps["hls_sobel"]')),
    ],
    "9.1": [
        ("in radians", ("np.degrees", "")),
        (
            "the sign is wrong",
            ("1 - seen_width_m / true_width_m", "seen_width_m / true_width_m - 1"),
        ),
    ],
    "10.1": [
        (
            "the larger of the two sides",
            (
                "np.maximum(np.roll(road, reach), np.roll(road, -reach))",
                "np.roll(road, reach)",
            ),
        ),
        ("take no absolute value", ("return (centre", "return np.abs(centre")),
        ("divide by 1 + n", (" / (1 + noise)", "")),
        ("Check gap", ("width // 2 + 3", "width // 2 + 2")),
    ],
    "11.1": [
        ("use x^2 / 2", ("x_m**2 / 2", "x_m**2")),
        ("not with the right line", (HALF, "width_m / 2")),
        ("Use width_m and left", (HALF, "np.where(left, 1.83, -1.83)")),
        (
            "with candidates of both lines",
            (
                "    design",
                "    if left.any():\n        x_m, y_m, left = x_m[left], y_m[left], "
                "left[left]\n    design",
            ),
        ),
    ],
    "12.1": [
        ("too unsure", "q_factor = 100"),
        ("too sure", "q_factor = 0.01"),
    ],
    "12.2": [
        ("H is not square", GATE.replace("H.T + R", "H + R")),
        ("P is not updated", GATE.replace("P - K @ H @ P", "P")),
        ("not its root", GATE.replace("> 11.3", "> 11.3**2")),
        ("the diagonal of S", GATE.replace("solve(S", "solve(np.diag(np.diag(S))")),
        ("None is returned", GATE.replace("return state, P\n", "return None\n")),
    ],
    "13.1": [
        ("Rows come first", "occlusion_map = lambda image, camera: np.zeros((15, 4))"),
        (
            "Take the absolute difference",
            "occlusion_map = lambda image, camera: np.full((4, 15), -0.1)",
        ),
    ],
    "14.1": [
        ("the other way round", ("-confidence", "confidence")),
        (
            "first falls below",
            ("count[enough[-1]]", "np.flatnonzero(share < least)[0]"),
        ),
        ("return 0, not 1.0", ("return 0", "return 1.0")),
    ],
    "15.1": [
        (
            "find_lane is the engine",
            "honest_finder = lambda image, camera: lanes.find_lane(image, camera)",
        ),
    ],
    "16.1": [
        ("points downhill", (GRADIENT, f"-{GRADIENT}")),
        ("mean over the examples", (GRADIENT, "cells.T @ too_large, too_large.sum()")),
        ("Its input is always 1", ("too_large.mean()", "0.0")),
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
