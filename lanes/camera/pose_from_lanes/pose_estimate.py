"""The camera pose from the road: how the camera sits on the car, read off the lane lines of its own pictures.

Parallel lines on a flat road meet on the horizon (`vanishing`). Its height in the picture is the pitch; where the
lines meet along it is the yaw, because a car's heading in its lane averages to zero over a drive. Lanes of equal width
that look narrower on one side are the roll. The width of a lane in metres, over its width in camera heights, is the
height.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass

import cv2
import numpy as np

from lanes.camera.camera import Camera
from lanes.camera.camera_pose import CameraPose
from lanes.camera.pose_from_lanes.lane_width import USUAL_HEIGHT_M, USUAL_ROLL_STD, LaneView, lane_share, view_lanes
from lanes.camera.pose_from_lanes.segments import Segments, find_segments
from lanes.camera.pose_from_lanes.vanishing_point import DIRECTIONS, HORIZONS, RoadLines, fit_lines, vote
from lanes.io.describe import html_table

# 12 ft, the lane of US Interstates (AASHTO, A Policy on Design Standards: Interstate System); motorway lanes elsewhere
# are 3.50 to 3.75 m, hence the standard deviation.
LANE_WIDTH_M, LANE_WIDTH_STD_M = 3.66, 0.10
# A camera is aimed ahead by eye, and a car along its lane: both together within about ten degrees.
USUAL_DIRECTION_STD = np.radians(10.0)
# How much the horizon nods on the road, and how far the car may head away from its lane (radians, one picture).
PITCH_MOTION, HEADING_MOTION = np.radians(0.3), np.radians(1.0)
# Refused below: rows of paint in a picture, share of pictures with lines, share of those with a lane.
FEWEST_ROWS, FEWEST_PICTURES, FEWEST_LANES = 60, 0.25, 0.3
# Refused above: scatter of the road's direction, and its angle to the camera.
WIDEST_SCATTER_DEG, WIDEST_YAW_DEG = 10.0, 12.0
# Fewer pictures than this do not average the heading out.
FEW_HEADINGS = 5
# In narrower or lower pictures a line is thinner than a pixel a few metres ahead.
LEAST_SIDE_PX = 48
# The pictures are worked on at this width: more pixels find no more paint.
WORKING_WIDTH = 1280
# Largest error of the offset in 95 % of the frames of the rendered drive, with its lens, and with focal lengths from
# 0.7 to 1.5 times the true one and no distortion (docs/own_camera.md).
LENS_OFFSET_CM, PINHOLE_OFFSET_CM = 1, 3
ANGLES = "pitch", "yaw", "roll"
# First look for the horizon: in this many pictures, from these shares of the picture's height.
ROUGH_PICTURES, ROUGH_HORIZONS = 8, np.array([0.3, 0.45, 0.6, 0.75])


class PoseError(ValueError):
    """The pictures do not tell how the camera is mounted; the message says why and what to do."""

    # Of a command: the input is fine, but the work could not be done with it.
    exit_status = 1


@dataclass(frozen=True)
class PoseEstimate:
    """How the camera is mounted, and how sure that is.

    Attributes
    ----------
    pose : CameraPose
        The estimate.
    height_std_m, pitch_std_rad, yaw_std_rad, roll_std_rad : float
        Standard deviations. The height's includes that of the assumed lane width.
    frames_used, frames_total : int
        Pictures with at least two parallel lines, and all pictures.
    pitch_spread_rad, yaw_spread_rad : float
        How much single pictures scatter: the car's nodding and its heading in the lane are in it.
    lane_width_m : float
        The lane width that the height rests on (that it would imply, where the height was given).
    notes : tuple of str
        What the pictures could not tell.
    """

    pose: CameraPose
    height_std_m: float
    pitch_std_rad: float
    yaw_std_rad: float
    roll_std_rad: float
    frames_used: int
    frames_total: int
    pitch_spread_rad: float
    yaw_spread_rad: float
    lane_width_m: float
    notes: tuple[str, ...] = ()

    def describe(self) -> str:
        """A few lines for people."""
        m = self.pose
        return "\n".join(
            [
                f"height {m.height_m:6.2f} m   +- {self.height_std_m:.2f}  (lane {self.lane_width_m:.2f} m wide)",
                _angle_line("pitch", m.pitch_rad, self.pitch_std_rad, "looks down", "looks up"),
                _angle_line("yaw", m.yaw_rad, self.yaw_std_rad, "looks left", "looks right"),
                _angle_line("roll", m.roll_rad, self.roll_std_rad, "right side down", "left side down"),
                f"from {self.frames_used} of {self.frames_total} pictures",
                *(f"note: {note}" for note in self.notes),
            ]
        )

    def summary(self) -> dict[str, str]:
        """Each number with its standard deviation, by name."""
        angles = {name: (getattr(self.pose, f"{name}_rad"), getattr(self, f"{name}_std_rad")) for name in ANGLES}
        return {
            "height": f"{self.pose.height_m:.2f} ± {self.height_std_m:.2f} m (lane {self.lane_width_m:.2f} m wide)",
            **{name: f"{np.degrees(angle):.2f} ± {np.degrees(std):.2f} deg" for name, (angle, std) in angles.items()},
            "pictures": f"{self.frames_used} of {self.frames_total} used",
        }

    def __repr__(self) -> str:
        return f"PoseEstimate({', '.join(f'{name} {words}' for name, words in self.summary().items())})"

    def _repr_html_(self) -> str:
        return html_table(
            "How the camera is mounted", self.summary() | {f"note {n}": note for n, note in enumerate(self.notes, 1)}
        )


def estimate_pose(
    images: Iterable[np.ndarray],
    camera: Camera,
    *,
    lane_width_m: float = LANE_WIDTH_M,
    height_m: float | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> PoseEstimate:
    """Estimate height, pitch, yaw and roll of a camera from pictures of one drive.

    Parameters
    ----------
    images : iterable of ndarray of shape (height, width, 3), uint8
        RGB, raw, of the camera's size. All are held in memory; 20 to 60, spread over the drive, are plenty.
    camera : Camera
        Its lens; a camera pose it may have is ignored.
    lane_width_m : float
        Distance between the centres of the ego lane's lines, for the height.
    height_m : float, optional
        The camera's height above the road where it was measured; then the lane width is not used.
    progress : callable, optional
        Called with (pictures done, pictures in all).

    Returns
    -------
    PoseEstimate

    Raises
    ------
    PoseError
        If too few pictures show two parallel lines, if they disagree, if no lane of plausible width is seen, or if the
        lane width or height given are nobody's.
    PictureError
        If a picture has another size than the camera.
    """
    _require_plausible(lane_width_m, height_m)
    if min(camera.size) < LEAST_SIDE_PX:
        raise PoseError(f"pictures of {camera.width}x{camera.height} pixels are too small to show lines; give larger.")
    images, camera = _working_copies(images, camera)
    rough = _rough_horizon(images, camera)
    pieces = []
    for done, image in enumerate(images, 1):
        pieces.append(find_segments(image, camera, _horizon_row(camera, rough)))
        if progress:
            progress(done, len(images))
    horizon = _voted_horizon(pieces)
    lanes = LaneView(USUAL_HEIGHT_M, 0.0, 0.0, USUAL_ROLL_STD)
    for _ in range(2):
        # Roll tilts the horizon, so it is taken out before the lines are fitted again.
        lines = _usable_lines([p.rolled_back(lanes.roll_rad) for p in pieces], horizon)
        _require_lines(lines, len(images))
        lanes = view_lanes(lines, lane_width_m, height_m or USUAL_HEIGHT_M, lanes.roll_rad)
    _require_lanes(lines, lane_width_m / lanes.height_m)
    return _conclude(lines, lanes, len(images), lane_width_m, height_m)


def describe_accuracy(estimate: PoseEstimate, camera: Camera) -> str:
    """What to expect of offsets, distances and curvatures that rest on an estimated pose; a sentence for people."""
    share = estimate.height_std_m / estimate.pose.height_m
    width = f" and {share:.0%} (lanes may be wider or narrower)" if share else ""
    if camera.distortion.any():
        return (
            f"expect offset and lane width to be good to {LENS_OFFSET_CM} cm{width}, distances and curvature likewise"
        )
    return (
        f"expect offset and lane width to be good to {PINHOLE_OFFSET_CM} cm{width}; "
        "distances ahead to be off as much as the focal length, which was not calibrated, and curvature twice as much"
    )


def _angle_line(name: str, angle_rad: float, std_rad: float, positive: str, negative: str) -> str:
    degrees, std = np.degrees([angle_rad, std_rad])
    words = "level" if abs(degrees) < 0.005 else positive if degrees > 0 else negative
    return f"{name:<6} {degrees:6.2f} deg +- {std:.2f}  ({words})"


def _require_plausible(lane_width_m: float, height_m: float | None) -> None:
    if not 2.0 <= lane_width_m <= 6.0:
        raise PoseError(f"a lane {lane_width_m} m wide is no road's; give 2 to 6 metres.")
    if height_m is not None and not 0.5 <= height_m <= 4.5:
        raise PoseError(f"a camera {height_m} m above the road is on no car; give 0.5 to 4.5 metres.")


def _working_copies(images: Iterable[np.ndarray], camera: Camera) -> tuple[list[np.ndarray], Camera]:
    """The pictures and the camera at WORKING_WIDTH, for which the numbers of pixels in `stripes` are meant."""
    working = camera.scaled((WORKING_WIDTH, round(camera.height * WORKING_WIDTH / camera.width)))
    way = cv2.INTER_AREA if camera.width > WORKING_WIDTH else cv2.INTER_LINEAR
    copies = []
    for number, image in enumerate(images, 1):
        camera.require_size(image, f"picture {number}")
        copies.append(image if camera.size == working.size else cv2.resize(image, working.size, interpolation=way))
    if not copies:
        raise PoseError("no picture was given; name stills or a video of the drive.")
    return copies, working


def _horizon_row(camera: Camera, y0: float) -> float:
    return float(camera.matrix[1, 2] + camera.matrix[1, 1] * y0)


def _rough_horizon(images: list[np.ndarray], camera: Camera) -> float:
    """The horizon from a few pictures and several guesses together, each of which finds some of the stripes."""
    few = images[:: -(-len(images) // ROUGH_PICTURES)]
    guesses = camera.height * ROUGH_HORIZONS
    return _voted_horizon([find_segments(image, camera, guess) for image in few for guess in guesses])


def _voted_horizon(pieces: list[Segments]) -> float:
    """The y0 on which the pictures agree, each free in its own direction and bend."""
    usual = np.exp(-0.5 * (DIRECTIONS / USUAL_DIRECTION_STD) ** 2)
    votes = sum((vote(p) * usual).max(axis=(1, 2)) for p in pieces)
    return float(HORIZONS[np.argmax(votes)])


def _usable_lines(pieces: list[Segments], horizon: float) -> list[RoadLines]:
    """The parallel lines of every picture that shows at least two and its horizon clearly."""
    found = [fit_lines(p, horizon, 3 * PITCH_MOTION) for p in pieces]
    return [f for f in found if f is not None and f.y0_std < PITCH_MOTION and f.rows.sum() >= FEWEST_ROWS]


def _require_lines(lines: list[RoadLines], total: int) -> None:
    if len(lines) < max(1, FEWEST_PICTURES * total):
        raise PoseError(
            f"only {len(lines)} of {total} pictures show two or more parallel lane lines; "
            "give pictures of a marked road by day, with the lines of the own lane in view."
        )
    directions_deg = np.degrees(np.arctan([line.x0 for line in lines]))
    if _spread(directions_deg) > WIDEST_SCATTER_DEG or abs(np.median(directions_deg)) > WIDEST_YAW_DEG:
        raise PoseError(
            f"the lines found in {len(lines)} pictures run {np.median(directions_deg):.0f} degrees off the camera's "
            f"axis and scatter by {_spread(directions_deg):.0f}: they are no lane lines, or the road winds too much; "
            "give pictures of a straighter stretch from a camera that looks ahead."
        )


def _require_lanes(lines: list[RoadLines], lane: float) -> None:
    share = lane_share(lines, lane)
    if share < FEWEST_LANES:
        raise PoseError(
            f"only {share:.0%} of the {len(lines)} pictures with parallel lines show two that are a lane apart; "
            "give pictures in which both lines of the own lane are seen, or the lane width of this road."
        )


def _spread(values: np.ndarray) -> float:
    """Standard deviation from the median absolute deviation, which outliers do not touch."""
    return float(1.4826 * np.median(np.abs(values - np.median(values))))


def _conclude(
    lines: list[RoadLines], lanes: LaneView, total: int, lane_width_m: float, height_m: float | None
) -> PoseEstimate:
    pitches = -np.arctan([line.y0 for line in lines])
    # The vanishing point is the image of the direction ahead: x0 = tan(yaw) / cos(pitch), y0 = -tan(pitch).
    yaws = np.arctan([line.x0 for line in lines] * np.cos(pitches))
    pitch_rad, pitch_std_rad = _centre(pitches, [line.y0_std for line in lines], PITCH_MOTION)
    yaw_rad, yaw_std_rad = _centre(yaws, [line.x0_std for line in lines], HEADING_MOTION)
    height_std_m = float(np.hypot(lanes.height_std_m, lanes.height_m * LANE_WIDTH_STD_M / lane_width_m))
    if height_m is not None:
        lane_width_m *= height_m / lanes.height_m
        height_std_m = 0.0
    return PoseEstimate(
        pose=CameraPose(height_m or lanes.height_m, pitch_rad, yaw_rad, lanes.roll_rad),
        height_std_m=height_std_m,
        pitch_std_rad=pitch_std_rad,
        yaw_std_rad=yaw_std_rad,
        roll_std_rad=lanes.roll_std_rad,
        frames_used=len(lines),
        frames_total=total,
        pitch_spread_rad=_spread(pitches),
        yaw_spread_rad=_spread(yaws),
        lane_width_m=lane_width_m,
        notes=_notes(lines, lanes),
    )


def _notes(lines: list[RoadLines], lanes: LaneView) -> tuple[str, ...]:
    notes = []
    if lanes.roll_std_rad >= USUAL_ROLL_STD:
        notes.append("no lane beside the own one is seen well enough to tell the roll; it is taken to be level")
    if len(lines) < FEW_HEADINGS:
        notes.append("the yaw contains the car's heading in its lane, which only many pictures average out")
    return tuple(notes)


def _centre(values: np.ndarray, stds: list[float], motion: float) -> tuple[float, float]:
    """Weighted median of the pictures and its standard deviation; `motion` is what one picture may be off."""
    weight = 1 / (np.square(stds) + motion**2)
    order = np.argsort(values)
    share = (np.cumsum(weight[order]) - 0.5 * weight[order]) / weight.sum()
    # Few values do not show how much they scatter, so `motion` counts like two more of them.
    variance = (len(values) * _spread(values) ** 2 + 2 * motion**2) / (len(values) + 2)
    # A median of n normal values has the variance pi / 2n.
    return float(np.interp(0.5, share, values[order])), float(np.sqrt(np.pi / 2 * variance / len(values)))
