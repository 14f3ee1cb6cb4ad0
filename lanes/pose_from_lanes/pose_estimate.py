"""Result of the pose estimation: camera pose, standard deviations, and the expected accuracy in words."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lanes.camera.camera import Camera
from lanes.camera.camera_pose import CameraPose
from lanes.io.describe import html_table

# 95th percentile of the offset error on the rendered drive, in centimetres: with its calibrated lens, and without
# distortion at focal lengths from 0.7 to 1.5 times the true one (docs/own_camera.md).
CALIBRATED_OFFSET_ERROR_CM, UNCALIBRATED_OFFSET_ERROR_CM = 1, 3


class PoseError(ValueError):
    """The camera pose cannot be estimated from the pictures; the message says why and what to do."""

    # Exit status of a command: the input is valid, but the task failed.
    exit_status = 1


@dataclass(frozen=True)
class PoseEstimate:
    """Estimated camera pose with standard deviations.

    Attributes
    ----------
    pose : CameraPose
    height_std_m, pitch_std_rad, yaw_std_rad, roll_std_rad : float
        Standard deviations. That of the height includes the uncertainty of the assumed lane width.
    frames_used, frames_total : int
        Pictures with at least two parallel lines, and all pictures.
    lane_width_m : float or None
        Lane width that determines the height. If the height was given, the lane width that follows from it. None if
        the height does not come from lane lines.
    notes : tuple of str
        Quantities that the pictures do not determine.
    """

    pose: CameraPose
    height_std_m: float
    pitch_std_rad: float
    yaw_std_rad: float
    roll_std_rad: float
    frames_used: int
    frames_total: int
    lane_width_m: float | None
    notes: tuple[str, ...] = ()

    @property
    def _height_source(self) -> str:
        if self.lane_width_m is None:
            return "assumed" if self.height_std_m else "given"
        return f"lane {self.lane_width_m:.2f} m wide"

    def describe(self) -> str:
        """Several lines of text: each number with its standard deviation and sign in words, pictures used, notes."""
        pose = self.pose
        return "\n".join(
            [
                f"height {pose.height_m:6.2f} m   +- {self.height_std_m:.2f}  ({self._height_source})",
                _describe_angle("pitch", pose.pitch_rad, self.pitch_std_rad, "looks down", "looks up"),
                _describe_angle("yaw", pose.yaw_rad, self.yaw_std_rad, "looks left", "looks right", "straight ahead"),
                _describe_angle("roll", pose.roll_rad, self.roll_std_rad, "right side down", "left side down"),
                f"from {self.frames_used} of {self.frames_total} pictures",
                *(f"note: {note}" for note in self.notes),
            ]
        )

    def summary(self) -> dict[str, str]:
        """Each number with its standard deviation, by name."""
        pose = self.pose
        return {
            "height": f"{pose.height_m:.2f} ± {self.height_std_m:.2f} m ({self._height_source})",
            "pitch": f"{np.degrees(pose.pitch_rad):.2f} ± {np.degrees(self.pitch_std_rad):.2f} deg",
            "yaw": f"{np.degrees(pose.yaw_rad):.2f} ± {np.degrees(self.yaw_std_rad):.2f} deg",
            "roll": f"{np.degrees(pose.roll_rad):.2f} ± {np.degrees(self.roll_std_rad):.2f} deg",
            "pictures": f"{self.frames_used} of {self.frames_total} used",
        }

    def summary_line(self) -> str:
        """One line with the numbers, and with what they were estimated from."""
        numbers = ", ".join(f"{name} {text}" for name, text in self.summary().items() if name != "pictures")
        return f"pose from {'all edges' if self.lane_width_m is None else 'lane lines'}: {numbers}"

    def __repr__(self) -> str:
        return f"PoseEstimate({', '.join(f'{name} {text}' for name, text in self.summary().items())})"

    def _repr_html_(self) -> str:
        notes = {f"note {number}": note for number, note in enumerate(self.notes, 1)}
        return html_table("Camera pose", self.summary() | notes)


def describe_accuracy(estimate: PoseEstimate, camera: Camera) -> str:
    """One sentence with the expected accuracy of offset, lane width, distances and curvature."""
    height_share = estimate.height_std_m / estimate.pose.height_m
    why = "the height is assumed" if estimate.lane_width_m is None else "lanes may be wider or narrower"
    width = f" and {height_share:.0%} ({why})" if height_share else ""
    if camera.distortion.any():
        return (
            f"expect offset and lane width to be good to {CALIBRATED_OFFSET_ERROR_CM} cm{width}, "
            "distances and curvature likewise"
        )
    return (
        f"expect offset and lane width to be good to {UNCALIBRATED_OFFSET_ERROR_CM} cm{width}; "
        "distances ahead to be off as much as the focal length, which was not calibrated, and curvature twice as much"
    )


def _describe_angle(
    name: str, angle_rad: float, std_rad: float, positive: str, negative: str, none: str = "level"
) -> str:
    degrees, std = np.degrees([angle_rad, std_rad])
    degrees = round(degrees, 2) + 0.0  # not -0.00
    direction = none if degrees == 0 else positive if degrees > 0 else negative
    return f"{name:<6} {degrees:6.2f} deg +- {std:.2f}  ({direction})"
