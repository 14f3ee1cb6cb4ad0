"""Wrong answers to the exercises of chapter 6: code that sets it, and a part of its hint."""

WRONG_ANSWERS = {
    "6.1": [
        ("width_m = right_start - left_start", "distance in columns"),
        ("width_m = (right_start - left_start) * 3.7 / 700", "another warp"),
    ],
}
