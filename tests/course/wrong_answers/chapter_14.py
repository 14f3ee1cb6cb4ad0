"""Wrong answers to the exercise of chapter 14: code that sets it, and a part of its hint."""

_SHARE = """
def share_right(confidence, right, low, high):
    group = (confidence >= low) & (confidence < high)
    return right[group].mean() if group.any() else np.nan
"""

WRONG_ANSWERS = {
    "14.1": [
        (_SHARE.replace("right[group].mean()", "(right & group).mean()"), "a share of all frames"),
        (_SHARE.replace("right[group].mean()", "group[right].mean()"), "a share of the right frames"),
        (_SHARE.replace("right[group].mean()", "right[group].sum()"), "the number of right frames"),
        (_SHARE.replace("right[group].mean()", "confidence[group].mean()"), "the mean confidence"),
        (_SHARE.replace("right[group].mean()", "(~right[group]).mean()"), "the share of wrong frames"),
        (_SHARE.replace("< high", "<= high"), "exactly `high`"),
        (_SHARE.replace(">= low", "> low"), "exactly `low`"),
        (_SHARE.replace("np.nan", "0.0"), "return np.nan, not 0.0"),
        (_SHARE.replace("np.nan", "None"), "return np.nan, not None"),
        (_SHARE.replace("right[group].mean()", "right.mean()"), "the true share"),
        (_SHARE.replace("right[group].mean()", "right[group]"), "return one number"),
    ],
}
