"""Wrong answers to the exercise of chapter 16: code that sets it, and a part of its hint."""

_GRADIENT = """
def loss_gradient(cells, is_paint, weights, bias):
    p = 1 / (1 + np.exp(-(cells @ weights + bias)))
    wrong = p - is_paint
    return {}
"""

WRONG_ANSWERS = {
    "16.1": [
        (_GRADIENT.format("cells.T @ -wrong / len(cells), -wrong.mean()"), "points downhill"),
        (_GRADIENT.format("cells.T @ wrong, wrong.sum()"), "mean over the examples"),
        (_GRADIENT.format("cells.T @ (wrong * p * (1 - p)) / len(cells), wrong.mean()"), "cancel"),
        (_GRADIENT.format("cells.T @ wrong / len(cells), 0.0"), "Its input is always 1"),
        (_GRADIENT.format("cells.T @ wrong * np.nan, wrong.mean()"), "off by up to nan"),
        (_GRADIENT.format("cells * wrong[:, None], wrong"), "the shapes are"),
        (_GRADIENT.format("wrong.mean()"), "return two things"),
    ],
}
