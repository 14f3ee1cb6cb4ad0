"""Wrong answers to the exercise of chapter 3: code that sets it, and a part of its hint."""

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

WRONG_ANSWERS = {
    "3.1": [
        (_UNDISTORT.replace("range(20)", "range(1)"), "Repeat until it no longer moves"),
        (_UNDISTORT.replace("range(20)", "range(3)"), "Repeat until it no longer moves"),
        (_UNDISTORT.replace("range(20)", "range(0)"), "x_d and y_d stay the same"),
        (_UNDISTORT.replace(_DIVISION, "x, y = x_d / radial - shift_x, y_d / radial - shift_y"), "then divide"),
        (_UNDISTORT.replace("k1, k2, p1, p2, k3", "k1, k2, p2, p1, k3"), "p1 and p2 are exchanged"),
        (_UNDISTORT.replace("k1, k2, p1, p2, k3", "k1, k2, k3, p1, p2"), "the order of the five numbers"),
        (_UNDISTORT.replace(_DIVISION, _DIVISION.replace("_d", "")), "keep x_d and y_d"),
        (_UNDISTORT.replace("x_d - shift_x", "x_d + shift_x").replace("y_d - s", "y_d + s"), "have the wrong sign"),
        (_UNDISTORT.replace("x_d - shift_x", "x_d").replace("y_d - shift_y", "y_d"), "are missing"),
        (_UNDISTORT.replace("/ radial", "* radial"), "the wrong way"),
        (_UNDISTORT.replace("1 + k1 * r2 + k2 * r2**2", "1 - k1 * r2 - k2 * r2**2"), "the wrong way"),
        (_UNDISTORT.replace("(u - c_x)", "u").replace("(v - c_y)", "v"), "the principal point must stay"),
        (_UNDISTORT.replace("return f_x * x + c_x, f_y * y + c_y", "return x, y"), "the principal point must stay"),
        (_UNDISTORT.replace("(x_d - shift_x)", "(x - shift_x)").replace("range(20)", "range(3)"), "x_d and y_d stay"),
        ("def undistort_pixel(u, v, matrix, distortion):\n    return u", "return two numbers"),
    ],
}
