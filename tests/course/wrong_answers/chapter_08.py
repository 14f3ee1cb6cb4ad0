"""Wrong answers to the exercises of chapter 8: code that sets it, and a part of its hint."""

_ENDS = "ends_m = np.array([[7, np.polyval(left_road, 7)], [7, np.polyval(right_road, 7)]]); "

WRONG_ANSWERS = {
    "8.1": [
        ("bar_px = 500", "two points"),
        (_ENDS + "bar_px = camera.undistort_points(camera.road_to_pixels(ends_m))", "forgot the lens"),
        (_ENDS + "bar_px = camera.road_to_pixels(ends_m)[:, ::-1]", "(row, column)"),
        (_ENDS + "bar_px = camera.road_to_pixels(ends_m)[::-1]", "exchanged"),
        (_ENDS + "bar_px = camera.road_to_pixels(ends_m * [1, -1])", "sign of y"),
        (_ENDS + "bar_px = camera.road_to_pixels(ends_m[:, ::-1] * [1, 7])", "NaN"),
        (_ENDS + "bar_px = pose_warp.points_to_birdseye(camera.road_to_pixels(ends_m))", "px off"),
    ],
}
