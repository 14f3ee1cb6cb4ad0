"""Result types: the observation of a line in a frame, one line, and the lane with its geometry, all in metres."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from lanes.camera import Camera
from lanes.describe import describe_bend, describe_heading, describe_offset, describe_std, html_table
from lanes.detect.fit import FIT
from lanes.detect.line_type import MarkingProfile, MarkingVotes
from lanes.detect.road import (
    CENTRE,
    CURVATURE,
    HEADING,
    PITCH,
    SIDES,
    VERTICAL_CURVATURE,
    WIDTH,
    lateral_std_m,
    line_coefficients,
    line_points,
    line_y,
    line_y_gradients,
    propagated_std,
    road_height,
)

# Default arc lengths of an outline: from below the picture to the horizon.
OUTLINE_M = np.geomspace(3.0, 400.0, 120)


@dataclass(frozen=True)
class LineObservation:
    """Evidence for one line in a frame."""

    # Share of the line's visible rows, up to 50 m, that have markings on them: 0.3 is a good dashed line.
    support: float = 0.0
    # Distance of its farthest stripe.
    reach_m: float = 0.0
    # Latest cross-section of the marking.
    profile: MarkingProfile | None = None
    # Number of visible rows of the line; None if not counted yet.
    rows: int | None = None
    # On the type of the marking.
    votes: MarkingVotes = MarkingVotes()

    @property
    def double_profile(self) -> MarkingProfile | None:
        """The profile of a double line; None if the line is single, by its profile or by the votes."""
        return self.profile if self.profile and self.profile.double and self.votes.marking_type.double else None

    def coast(self, distance_m: float, *, vote: bool) -> LineObservation:
        """The observation after driving on without detection: no support, and the reach comes nearer.

        `vote`: the latest profile votes again.
        """
        votes = self.votes.add_profile(self.profile) if vote else self.votes
        return LineObservation(0.0, max(self.reach_m - distance_m, 0.0), self.profile, votes=votes)


Observations = tuple[LineObservation, LineObservation]


@dataclass(frozen=True, eq=False)
class LaneLine:
    """One line of the lane: y(x) = c0 + c1 x + c2 x^2 / 2 + c3 x^3 / 6 near the car, metres, x forward, y left.

    Support, reach and profile are those of its `LineObservation`.
    """

    c0_m: float
    c1: float
    c2_per_m: float
    c3_per_m2: float
    # Standard deviation of `c0_m`.
    c0_std_m: float
    support: float
    reach_m: float
    profile: MarkingProfile | None = None

    @property
    def seen(self) -> bool:
        """False if the line was only inferred from other lines and the usual width of lanes."""
        return self.support >= FIT.min_support

    def y(self, x_m: float | np.ndarray) -> float | np.ndarray:
        """Lateral position at distances x near the car, metres."""
        return self.c0_m + x_m * (self.c1 + x_m * (self.c2_per_m / 2 + x_m * self.c3_per_m2 / 6))

    def summary(self) -> str:
        """Lateral position at the car, and the evidence for it."""
        beside = f"{abs(self.c0_m):.2f} ± {describe_std(self.c0_std_m)} m {'left' if self.c0_m > 0 else 'right'}"
        if not self.seen:
            return f"{beside}, inferred from other lines"
        return f"{beside}, paint on {min(self.support, 1):.0%} of its rows, up to {self.reach_m:.0f} m"


@dataclass(frozen=True, eq=False)
class Lane:
    """The ego lane, in SI units.

    Attributes
    ----------
    model : ndarray (15,)
        Parameters as in `lanes.detect.road`, for the stripes next to the lane.
    centres : ndarray (15,)
        The same for the centres of double lines, which the tracker follows.
    covariance : ndarray (15, 15)
        Of the errors of the parameters, given the camera pose; see `lanes.detect.error_covariance`.
    assumed_covariance : ndarray (15, 15)
        The larger one of the noise that the fit assumes. A track starts with it.
    observations : (LineObservation, LineObservation)
        Of the left and the right line.
    score : float
        Sum of the square roots of the lines' supports minus the penalty of the prior.
    explained_share : float
        Share of everything in view that looks like paint which the lines of this lane and of its neighbours explain.
    clear_share : float
        Of the stripes along the lane, on its lines and between them, the share on its lines; 1 of a tracked lane. Tiles
        and bricks have lines between those of the lane.
    transverse_stripes : int
        Painted stripes across the lane, up to 30 m ahead; 0 of a tracked lane. Tiles and bricks have several, few
        roads have more than one.
    margin : float or None
        Score minus that of the best lane elsewhere, which counts at least 0; None of a tracked lane.
    same_lane_share : float or None
        If the camera pose was estimated from the same image: the share of the poses tried that show this lane, 0 to 1.
    camera_yaw_rad : float or None
        Direction of the car's axis, seen from the camera as its pose says, positive left; None of a still. It is large
        if the yaw of the pose is wrong.
    """

    model: np.ndarray
    centres: np.ndarray
    covariance: np.ndarray
    assumed_covariance: np.ndarray
    observations: Observations
    score: float
    explained_share: float = 1.0
    clear_share: float = 1.0
    transverse_stripes: int = 0
    margin: float | None = None
    same_lane_share: float | None = None
    camera_yaw_rad: float | None = None

    @property
    def offset_m(self) -> float:
        """Position of the car left of the lane centre."""
        return float(-self.model[CENTRE])

    @property
    def offset_std_m(self) -> float:
        """Standard deviation of `offset_m`."""
        return self._std(CENTRE)

    @property
    def heading_rad(self) -> float:
        """Direction of the road seen from the car, positive left."""
        return float(self.model[HEADING])

    @property
    def heading_std_rad(self) -> float:
        """Standard deviation of `heading_rad`."""
        return self._std(HEADING)

    @property
    def curvature_per_m(self) -> float:
        """Curvature of the lane centre beside the car; positive for a left bend."""
        return float(self.model[CURVATURE] / (1 - self.model[CURVATURE] * self.model[CENTRE]))

    @property
    def curvature_std_per_m(self) -> float:
        """Standard deviation of `curvature_per_m`."""
        return self._std(CURVATURE)

    @property
    def width_m(self) -> float:
        """Distance between the lines."""
        return float(self.model[WIDTH])

    @property
    def width_std_m(self) -> float:
        """Standard deviation of `width_m`."""
        return self._std(WIDTH)

    @property
    def pitch_rad(self) -> float:
        """Pitch of the camera in this frame minus that of its pose, positive down."""
        return float(self.model[PITCH])

    @property
    def vertical_per_m(self) -> float:
        """Vertical curvature of the road at the car, positive upwards."""
        return float(self.model[VERTICAL_CURVATURE][0])

    def _std(self, parameter: int) -> float:
        return float(np.sqrt(self.covariance[parameter, parameter]))

    @cached_property
    def lines(self) -> tuple[LaneLine, LaneLine]:
        """The left and the right line."""
        stds_m = lateral_std_m(self.covariance, 0.0).tolist()
        left, right = (
            LaneLine(*line_coefficients(self.model, side), std_m, line.support, line.reach_m, line.profile)
            for side, std_m, line in zip(SIDES, stds_m, self.observations, strict=True)
        )
        return left, right

    @property
    def left(self) -> LaneLine:
        """The left line."""
        return self.lines[0]

    @property
    def right(self) -> LaneLine:
        """The right line."""
        return self.lines[1]

    def summary(self) -> dict[str, str]:
        """Offset, bend, heading, width and both lines in words, by name."""
        return {
            "offset": describe_offset(self.offset_m, self.offset_std_m),
            "bend": f"{describe_bend(self.curvature_per_m)} "
            f"({1e3 * self.curvature_per_m:.2f} ± {1e3 * self.curvature_std_per_m:.2f} per km)",
            "heading": describe_heading(self.heading_rad),
            "width": f"{self.width_m:.2f} ± {describe_std(self.width_std_m)} m",
            "left line": self.left.summary(),
            "right line": self.right.summary(),
        }

    def __repr__(self) -> str:
        words = self.summary()
        return f"Lane({words['offset']}, {describe_bend(self.curvature_per_m)}, {words['width']} wide)"

    def _repr_html_(self) -> str:
        return html_table("Lane", self.summary())

    def lateral_m(self, x_m: np.ndarray) -> np.ndarray:
        """Lateral positions (2, N) of the left and right line at distances (N,), metres; as `line_y`."""
        return np.array([self.line_y(x_m, side) for side in SIDES])

    def line_y(self, x_m: np.ndarray, side: float) -> np.ndarray:
        """Lateral position (N,) of the left (+1) or right (-1) line at distances (N,); NaN where it has turned back."""
        return line_y(np.asarray(x_m, float), self.model, side)

    def lateral_std_m(self, x_m: np.ndarray) -> np.ndarray:
        """Standard deviation (2, N) of `lateral_m` at distances (N,), metres; NaN where a line has turned back."""
        gradients = np.array([line_y_gradients(np.asarray(x_m, float), self.model, side) for side in SIDES])
        return propagated_std(gradients, self.covariance)

    def outlines(self, camera: Camera, *, along_m: np.ndarray = OUTLINE_M) -> tuple[np.ndarray, np.ndarray]:
        """Raw pixels (N, 2) of the left and of the right line at arc lengths `along_m`, ascending.

        Each ends where the line turns back, dips behind a crest or leaves the lens. It has at least two points or none.
        """
        points = np.empty((len(SIDES), len(along_m), 3))
        points[..., :2] = line_points(self.model, SIDES, along_m)
        points[..., 2] = road_height(self.model, points[..., 0])
        pose = camera.require_pose()
        pose = replace(pose, pitch_rad=pose.pitch_rad + self.pitch_rad)
        pixels = camera.with_pose(pose).road_to_pixels(points.reshape(-1, 3))
        left, right = pixels.reshape(*points.shape[:2], 2)
        return _visible_part(left), _visible_part(right)

    def pixels(self, camera: Camera, rows: np.ndarray) -> np.ndarray:
        """Columns (2, rows) of the left and the right line at picture rows; -2 where they do not pass."""
        rows = np.asarray(rows, float)
        columns = np.full((2, len(rows)), -2.0)
        for k, outline in enumerate(self.outlines(camera)):
            if len(outline):
                columns[k] = np.interp(rows, outline[::-1, 1], outline[::-1, 0], left=-2, right=-2)
        return np.where((columns >= 0) & (columns <= camera.width - 1), columns, -2.0)


def _visible_part(pixels: np.ndarray) -> np.ndarray:
    """The points (N, 2) of a line, nearest first, while they rise in the picture; NaN at the beginning is left out."""
    pixels = pixels[int(np.isfinite(pixels[:, 0]).argmax()) :]
    # comparisons with NaN are False: a point outside the lens ends the line
    rises = pixels[1:, 1] < pixels[:-1, 1]
    end = len(pixels) if rises.all() else int(rises.argmin()) + 1
    return pixels[: end if end > 1 else 0]
