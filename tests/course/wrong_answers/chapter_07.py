"""Wrong answers to the exercises of chapter 7: code that sets it, and a part of its hint."""

WRONG_ANSWERS = {
    "7.1": [
        ("ransac_choice = 29", "two whole numbers"),
        ("ransac_choice = 2, 18", "three coefficients"),
        ("ransac_choice = 3, 105", "not 0.4 to the power of 3"),
        ("ransac_choice = 3, 28", "99.89%. Required are 99.90%"),
        ("ransac_choice = 3, 30", "not the smallest number"),
        ("ransac_choice = 3, 5", "at least one of 5 samples"),
        ("ransac_choice = 150, 40", "is clean with the probability 0.0%"),
    ],
    "7.2": [
        ("corrected = 888", "three numbers"),
        ("corrected = 724, 1614, 0.170", "s_v squared over s_u"),
        ("f = 0.0430 / (30 / 720) / (0.00459 / (3.7 / 700)); corrected = 724 * f, 1614 * f, 0.170", "counts squared"),
        ("f = 0.8154; corrected = 724 * f, 1614 * f, 0.170", "upside down"),
        ("corrected = 724 * 1.065, 1614 * 1.065, 0.170", "depends on both scales"),
        ("corrected = 888, 1979, 0.170", "one scale, once"),
        ("corrected = 888, 1979, np.nan", "NaN"),
    ],
}
