"""Wrong answers to the exercises of chapter 4: code that sets them, and a part of their hints."""

_TO_METRES = """def to_metres(u, v):
    (far_x, left_y), (near_x, right_y) = rectangle_m[0], rectangle_m[2]
    x, y = far_x + (near_x - far_x) * v / 720, left_y + (right_y - left_y) * (u - 200) / 880
    return """

WRONG_ANSWERS = {
    "4.1": [
        ("my_source_px = source_px", "becomes narrower with the distance"),
        ("my_source_px = source_px[:, ::-1]", "Is the order (column, row)?"),
        ("my_source_px = source_px[[0, 2, 1, 3]]", "the edges cross"),
        ("my_source_px = source_px[[2, 3, 0, 1]]", "mirrored or upside down"),
        ("my_source_px = source_px[[1, 0, 3, 2]]", "mirrored or upside down"),
        ("my_source_px = source_px[0]", "four points"),
    ],
    "4.2": [
        (_TO_METRES + "x, -y", "y is positive to the left"),
        (_TO_METRES + "y, x", "Return x (forward) first"),
        (_TO_METRES + "x - near_x, y", "The bottom row is not below the camera"),
        (_TO_METRES + "near_x + far_x - x, y", "Row 0 is the far end"),
        (_TO_METRES + "x", "return two numbers"),
        ("def to_metres(u, v):\n    return (720 - v) * 30 / 720, (640 - u) * 3.7 / 700", "corners"),
    ],
}
