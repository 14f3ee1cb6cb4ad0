"""Wrong answers to the exercise of chapter 12: code that sets it, and a part of its hint."""

_STEP = """
def correct_gated(state, P, z, R, H):
    innovation, S = z - H @ state, H @ P @ H.T + R
    if innovation @ np.linalg.solve(S, innovation) > 11.3:
        return state, P
    K = P @ H.T @ np.linalg.inv(S)
    return state + K @ innovation, P - K @ H @ P
"""

WRONG_ANSWERS = {
    "12.1": [
        (_STEP.replace("H @ P @ H.T + R", "H @ P @ H + R"), "H is not square"),
        (_STEP.replace("K = P @ H.T @", "K = P @ H @"), "H is not square"),
        (_STEP.replace("P - K @ H @ P", "P"), "P is not updated"),
        (_STEP.replace("P - K @ H @ P", "P + K @ H @ P"), "is not P - K H P"),
        (_STEP.replace("z - H @ state", "H @ state - z"), "state + K (z - H state)"),
        (_STEP.replace("> 11.3", "> 1e9"), "is accepted"),
        (
            _STEP.replace(
                "if innovation @ np.linalg.solve(S, innovation)",
                "if np.sqrt(innovation @ np.linalg.solve(S, innovation))",
            ),
            "not its root",
        ),
        (_STEP.replace("solve(S, innovation)", "solve(R, innovation)"), "not R alone"),
        (_STEP.replace("solve(S, innovation)", "solve(np.diag(np.diag(S)), innovation)"), "the diagonal of S"),
        (_STEP.replace("return state, P\n", "return None\n"), "None is returned"),
        (_STEP.replace("return state, P\n", "return state, 2 * P\n"), "must leave P as it is"),
    ],
}
