"""Wrong answers to the exercise of chapter 1: code that sets it, and a part of its hint."""

_ERRORS = "best = np.polyfit(paint_rows, paint_columns, 1)\nerrors = np.polyval(best, paint_rows) - paint_columns\n"

WRONG_ANSWERS = {
    "1.1": [
        (_ERRORS + "best_ruler_px = abs(errors).mean()", "is a mean of the distances"),
        (_ERRORS + "best_ruler_px = (-errors).max()", "on one side only"),
        (_ERRORS + "best_ruler_px = abs(errors)", "one number is needed"),
        (
            "best = np.polyfit(paint_columns, paint_rows, 1)\n"
            "best_ruler_px = abs(np.polyval(best, paint_columns) - paint_rows).max()",
            "Swap the first two arguments",
        ),
        ("best_ruler_px = abs(ruler_miss).max()", "Fit all rows"),
    ],
}
