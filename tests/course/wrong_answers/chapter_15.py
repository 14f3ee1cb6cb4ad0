"""Wrong answers to the exercise of chapter 15."""

WRONG_ANSWERS = {
    "15.1": [
        ("better_finder = my_finder", "more; what do the wrong frames"),
        (
            "def better_finder(image, camera):\n    return [(0.0, 0.0, 640.0), (0.0, 0.0, 200.0)]",
            "in metres, left line first",
        ),
        ("def better_finder(image, camera):\n    return [(0.0, 0.0, 1.8)]", "two lines or None"),
    ],
}
