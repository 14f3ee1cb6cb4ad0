"""Wrong answers to the exercise of chapter 11: code that sets it, and a part of its hint."""

_FIT = """
def fit_known_width(x_m, y_m, left, width_m):
    design = np.column_stack([np.ones_like(x_m), x_m, x_m**2 / 2])
    return np.linalg.lstsq(design, {}, rcond=None)[0]
"""
_CENTRE = "y_m - np.where(left, 1, -1) * width_m / 2"

WRONG_ANSWERS = {
    "11.1": [
        (_FIT.format("y_m"), "this is the line"),
        (_FIT.format("y_m - np.where(left, 1, -1) * width_m"), "half a width from either line"),
        (_FIT.format("y_m + np.where(left, 1, -1) * width_m / 2"), "wrong side of the left line"),
        (_FIT.format("y_m - width_m / 2"), "not with the right line"),
        (_FIT.format("y_m - np.where(left, 1, -1) * 3.66 / 2"), "Use width_m and left"),
        (_FIT.format("y_m - np.where(y_m > 0, 1, -1) * width_m / 2"), "Use width_m and left"),
        (_FIT.replace("[0]\n", "[0] * np.nan\n").format(_CENTRE), "true are 0.25 m"),
        (_FIT.replace("x_m**2 / 2", "x_m**2").format(_CENTRE), "use x^2 / 2"),
        (
            _FIT.replace("np.ones_like(x_m), x_m, x_m**2 / 2", "left, ~left, x_m, x_m**2 / 2").format("y_m"),
            "shape (4,)",
        ),
    ],
}
