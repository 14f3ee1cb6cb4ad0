"""Wrong answers to the exercise of chapter 10: code that sets it, and a part of its hint."""

_FILTER = """
def stripe_response(row, width):
    mean = lambda values, count: np.convolve(values, np.ones(count) / count, mode="same")
    centre, road, reach = mean(row, width), mean(row, 3), width // 2 + 3
    left, right = np.roll(road, reach), np.roll(road, -reach)
    noise = 1 + mean(np.abs(np.diff(row, prepend=row[0])), 51)
    return {}
"""

WRONG_ANSWERS = {
    "10.1": [
        (_FILTER.format("(centre - (left + right) / 2) / noise"), "the larger of the two sides"),
        (_FILTER.format("(centre - np.minimum(left, right)) / noise"), "the larger of the two sides"),
        (_FILTER.format("(centre - left) / noise"), "the larger of the two sides"),
        (_FILTER.format("np.abs(centre - np.maximum(left, right)) / noise"), "a dark seam scores"),
        (_FILTER.format("(np.maximum(left, right) - centre) / noise"), "Subtract the road from the stripe"),
        (_FILTER.format("centre - np.maximum(left, right)"), "Divide by the noise"),
        (_FILTER.format("(centre - np.maximum(left, right)) / (noise - 1)"), "Divide by the noise, 1 + n"),
        (_FILTER.replace("51", "5").format("(centre - np.maximum(left, right)) / noise"), "mean over 51 cells"),
        (_FILTER.replace("width // 2 + 3", "4").format("(centre - np.maximum(left, right)) / noise"), "double line"),
        (
            _FILTER.replace("width // 2 + 3", "width // 2 + 2").format("(centre - np.maximum(left, right)) / noise"),
            "Check gap",
        ),
        (_FILTER.format("(centre - np.maximum(left, right)) / (noise * np.nan)"), "NaN or infinite"),
        (_FILTER.format("np.max(centre - np.maximum(left, right)) / noise[:5]"), "one number for each cell"),
    ],
}
