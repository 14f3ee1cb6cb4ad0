"""Wrong answers to the exercise of chapter 13: code that sets it, and a part of its hint."""

_FAILURE = """
def first_failure(image, camera):
    for degrees in range(60):
        pose = replace(camera.pose, pitch_rad=camera.pose.pitch_rad + np.radians(degrees))
        failed = helpers.explain(image, camera.with_pose(pose)).failed
        if failed:
            return degrees, failed.name
"""

WRONG_ANSWERS = {
    "13.1": [
        (_FAILURE.replace("np.radians(degrees)", "degrees"), "pitch_rad is in radians"),
        (_FAILURE.replace("+ np.radians", "- np.radians"), "you turned the camera up"),
        (_FAILURE.replace("degrees, failed.name", "degrees - 1, failed.name"), "no step fails yet"),
        (_FAILURE.replace("failed.name", "failed"), "take `.failed.name`"),
        (_FAILURE.replace("failed.name", "failed.failure"), "take `.failed.name`"),
        (_FAILURE.replace("degrees, failed.name", "degrees"), "return two values"),
        (_FAILURE.replace("range(60)", "range(0, 60, 5)"), "in turn"),
    ],
}
