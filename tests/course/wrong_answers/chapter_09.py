"""Wrong answers to the exercise of chapter 9: code that sets it, and a part of its hint."""

_ERROR = """
def pitch_error_deg(seen_width_m, distance_m, height_m, true_width_m):
    return {}
"""

WRONG_ANSWERS = {
    "9.1": [
        (_ERROR.format("height_m / distance_m * (1 - seen_width_m / true_width_m)"), "in radians"),
        (_ERROR.format("np.degrees(height_m / distance_m * (seen_width_m / true_width_m - 1))"), "the sign is wrong"),
        (
            _ERROR.format("np.degrees(height_m / distance_m * (true_width_m / seen_width_m - 1))"),
            "distance in the view",
        ),
        (_ERROR.format("np.degrees(height_m / distance_m * (1 - true_width_m / seen_width_m))"), "upside down"),
        (_ERROR.format("np.degrees((1 - seen_width_m / true_width_m) / distance_m)"), "the height is missing"),
        (_ERROR.format("np.degrees(np.arctan(height_m / distance_m))"), "Compare the two"),
        (_ERROR.format("distance_m, height_m"), "return one number"),
    ],
}
