"""The camera: model and file, lenses, chessboards and calibration, field of view
without a calibration.

In: images of boards, camera files, EXIF. Out: a `Camera`, which maps pixels to rays
and, with a pose, to the road.
"""
