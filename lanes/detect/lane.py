"""Results: the lane in one image or frame, and its two lines: geometry and evidence in
SI units.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from lanes.camera.model import Camera
from lanes.car import CarMotion, Departure, TrackedCar
from lanes.describe import (
    describe_bend,
    describe_heading,
    describe_offset,
    describe_std,
)
from lanes.detect.confidence import (
    CORRECT_AT_M,
    CORRECT_WITHIN_M,
    LEAST_CONFIDENCE,
    LIKELY_CONFIDENCE,
    ROAD_WIDTH,
    WEIGHTS,
    error_variance_factor,
    lane_features,
)
from lanes.detect.line_type import NO_VOTES, MarkingProfile, TypeVotes
from lanes.detect.road import (
    CENTRE,
    CURVATURE,
    HEADING,
    LEFT_SIDE,
    PITCH,
    RIGHT_SIDE,
    SIDES,
    VERTICAL_CURVATURE,
    WIDTH,
    UsualWidth,
    adjacent_lane_matrix,
    lateral_std_m,
    line_coefficients,
    line_points,
    line_y,
    line_y_gradients,
    propagated_std,
    road_height,
)
from lanes.equality import ByValue

# States of a lane: detected in a single image; tracked, but not yet confirmed; tracked;
# predicted while not seen; predicted while the camera repeats an image.
FOUND = "found"
SEARCHING = "searching"
TRACKING = "tracking"
COASTING = "coasting"
FROZEN = "frozen"
# Kind of a line without paint.
ROAD_EDGE = "road edge"
# Default arc lengths of an outline: from below the image to the horizon.
OUTLINE_M = np.geomspace(1.5, 400.0, 130)
# Columns that a line may pass from row to row. Where it passes more, two rows of pitch
# motion move it by more than the 20 pixels that TuSimple's score allows.
MAX_COLUMNS_PER_ROW = 10.0
# Column of a line in a row where it does not pass (TuSimple's format).
NO_COLUMN = -2.0


@dataclass(frozen=True)
class LineEvidence:
    """The observed evidence of one line.

    Attributes
    ----------
    support : float
        Share of the line's visible rows, up to 50 m, that have markings on them: 0.3 is
        a good dashed line.
    seen : bool
        Whether the support is large enough; otherwise the line is inferred from other
        lines and the usual lane width.
    reach_m : float
        Distance of the farthest marking on it, before a gap that is longer than those
        between dashes.
    start_m : float
        Smallest distance at which a marking was seen on it in this track; large where
        the bonnet hides the road.
    edge : bool
        Whether it is an edge of the road without paint: a kerb, or where the pavement
        ends.
    """

    support: float = 0.0
    seen: bool = False
    reach_m: float = 0.0
    edge: bool = False
    # Number of visible rows, None if not counted yet; latest cross-section; votes on
    # the type. The tracker carries them on from frame to frame.
    rows: int | None = None
    profile: MarkingProfile | None = None
    votes: TypeVotes = NO_VOTES
    start_m: float = 0.0

    @property
    def kind(self) -> str | None:
        """ "solid", "dashed" or "road edge"; None if not seen well enough."""
        return ROAD_EDGE if self.edge else self.votes.kind

    @property
    def double(self) -> bool | None:
        """Whether the line has two stripes side by side; None if not seen well enough,
        and of an edge of the road.
        """
        return None if self.edge else self.votes.double

    @property
    def colour(self) -> str | None:
        """ "white" or "yellow"; None if not seen well enough, without colours in the
        images, and of an edge of the road.
        """
        return None if self.edge else self.votes.colour

    @property
    def double_profile(self) -> MarkingProfile | None:
        """The profile of a double line; None if the line is single.

        It is single by its profile or by the votes.
        """
        if self.profile is None or not self.profile.double or not self.votes.double:
            return None
        return self.profile


# Of the far lines of the adjacent lanes to the left and right; None for a line that is
# not seen.
FarEvidence = tuple[LineEvidence | None, LineEvidence | None]


@dataclass(frozen=True, eq=False, kw_only=True)
class Line(ByValue, LineEvidence):
    """One line of a lane: its geometry, the uncertainty, and the evidence.

    Attributes
    ----------
    side : float
        +1 for the left line, -1 for the right one.
    model, covariance : ndarray (15,), (15, 15)
        Those of the lane; of a far line those of the adjacent lane.
    """

    side: float
    model: np.ndarray
    covariance: np.ndarray

    @cached_property
    def coefficients(self) -> tuple[float, float, float, float]:
        """(c0, c1, c2, c3) of the Taylor series y = c0 + c1 x + c2 x^2 / 2 + c3 x^3 / 6
        at the car, metres.
        """
        return line_coefficients(self.model, self.side)

    @property
    def offset_m(self) -> float:
        """Lateral position at the car (x = 0), positive left."""
        return self.coefficients[0]

    @property
    def offset_std_m(self) -> float:
        """Standard deviation of `offset_m`."""
        left_m, right_m = lateral_std_m(self.covariance, 0.0).tolist()
        return left_m if self.side > 0 else right_m

    def y(self, x_m: float | np.ndarray) -> np.ndarray:
        """Lateral positions (...) at distances x (...) ahead, metres.

        NaN where the line has turned back.
        """
        x = np.asarray(x_m, float)
        return line_y(x.ravel(), self.model, self.side).reshape(x.shape)

    def std_m(self, x_m: float | np.ndarray) -> np.ndarray:
        """Standard deviations (...) of `y` at distances x (...) ahead, metres.

        NaN where the line has turned back.
        """
        x = np.asarray(x_m, float)
        gradients = line_y_gradients(x.ravel(), self.model, self.side)
        return propagated_std(gradients, self.covariance).reshape(x.shape)

    def pixels(self, camera: Camera, *, along_m: np.ndarray = OUTLINE_M) -> np.ndarray:
        """Raw pixels (N, 2) of the line at arc lengths `along_m`, ascending.

        They end where the line turns back, dips behind a crest or leaves the lens; at
        least two points or none.
        """
        (pixels,) = project_lines(self.model, np.array([self.side]), camera, along_m)
        return visible_part(pixels)

    def seen_pixels(self, camera: Camera) -> np.ndarray:
        """`pixels` as far as markings are seen on the line, up to `reach_m`."""
        begin_m = OUTLINE_M[0]
        along_m = np.geomspace(begin_m, max(self.reach_m, begin_m), 40)
        return self.pixels(camera, along_m=along_m)

    def describe(self) -> str:
        """Words: lateral position at the car, type, and the evidence."""
        side = "left" if self.offset_m > 0 else "right"
        std = describe_std(self.offset_std_m)
        beside = f"{abs(self.offset_m):.2f} ± {std} m {side}"
        if not self.seen:
            return f"{beside}, inferred from other lines"
        share = min(self.support, 1)
        paint = f"paint on {share:.0%} of its rows, up to {self.reach_m:.0f} m"
        kind = self.describe_type()
        return f"{beside}, {kind}, {paint}" if kind else f"{beside}, {paint}"

    def __repr__(self) -> str:
        return f"Line({'left' if self.side > 0 else 'right'}, {self.describe()})"

    def describe_type(self) -> str:
        """Words such as "yellow double solid"; empty if not seen well enough."""
        words = [self.colour, "double" if self.double else None, self.kind]
        return " ".join(word for word in words if word)


@dataclass(frozen=True, eq=False)
class Lane(ByValue):
    """The ego lane in one image or frame, in SI units.

    Attributes
    ----------
    state : str
        "found": detected in a single image; "searching": tracked, not yet confirmed;
        "tracking"; "coasting": not seen now and predicted from before, or seen again in
        only a few frames; "frozen": predicted, because the picture stands still.
    model : ndarray (15,)
        Parameters as in `lanes.detect.road`, for the stripes next to the lane.
    centres : ndarray (15,)
        The same for the centres of double lines, which the tracker follows.
    fit_covariance : ndarray (15, 15)
        Covariance of the parameters for the noise that the fit or the filter assumes;
        see `covariance`.
    evidence : (LineEvidence, LineEvidence)
        Of the left and the right line.
    far_evidence : (LineEvidence or None, LineEvidence or None)
        Of the far lines of the adjacent lanes to the left and to the right; see
        `adjacent`.
    score : float
        Sum of the square roots of the lines' supports.
    clear_share : float
        Of the stripes along the lane, on its lines and between them, the share on its
        lines. Tiles and bricks have lines between those of the lane; so have two lanes
        that are taken for one.
    single_image_pose : bool
        Whether the camera pose was estimated from the same image. Its height is then
        uncertain, and with it the width of the lane.
    same_lane_share : float
        Share of the camera poses tried that show this lane; 1 if the pose was not
        estimated from the same image.
    car : TrackedCar or None
        The car as the track sees it; None of a single image.
    confidence_shift : float
        Added to the log odds of the confidence; that of the network that found the
        markings (docs/own_network.md).
    camera : Camera or None
        The camera with the pose that the lane was found with; the lines are relative to
        it.
    usual_width : UsualWidth
        Mean and standard deviation of lane widths; of a tracked lane those of its
        drive.
    """

    model: np.ndarray
    centres: np.ndarray
    fit_covariance: np.ndarray
    evidence: tuple[LineEvidence, LineEvidence]
    score: float
    state: str = FOUND
    clear_share: float = 1.0
    single_image_pose: bool = False
    same_lane_share: float = 1.0
    car: TrackedCar | None = None
    far_evidence: FarEvidence = (None, None)
    confidence_shift: float = 0.0
    camera: Camera | None = None
    usual_width: UsualWidth = ROAD_WIDTH

    @property
    def tracked(self) -> bool:
        """Whether the lane comes from a tracker, not from a single image."""
        return self.state != FOUND

    @property
    def camera_yaw_rad(self) -> float | None:
        """Direction of the car's axis in the camera pose, positive left; None of a
        single image.
        """
        return self.car.camera_yaw_rad if self.car else None

    @property
    def motion(self) -> CarMotion | None:
        """Speed, path and course of the car; None of a single image."""
        return self.car.motion if self.car else None

    @property
    def departure(self) -> Departure | None:
        """Time to line crossing; None of a single image."""
        return self.car.departure if self.car else None

    def with_known_pose(self) -> Lane:
        """The lane, rated as one whose camera pose is known."""
        return replace(self, single_image_pose=False, same_lane_share=1.0)

    @cached_property
    def covariance(self) -> np.ndarray:
        """(15, 15) covariance of the errors of the parameters, given the camera
        pose.
        """
        factor = error_variance_factor(self.model, tracked=self.tracked)
        return factor * self.fit_covariance

    @cached_property
    def total_covariance(self) -> np.ndarray:
        """(15, 15) `covariance` with the errors of an estimated camera pose, and of an
        assumed lens that it was estimated with.
        """
        camera = self.camera
        if camera is None or camera.pose_std is None:
            return self.covariance
        # a higher camera sees a larger road
        by_height = np.zeros(len(self.model))
        by_height[CENTRE] = self.model[CENTRE]
        by_height[WIDTH] = self.width_m
        by_height[CURVATURE] = -self.model[CURVATURE]
        by_height *= camera.pose_std.height_share
        # a roll moves both lines to the same side
        height_m = camera.require_pose().height_m
        by_roll_m = height_m + (self.width_m / 2) ** 2 / height_m
        by_roll_m *= camera.pose_std.roll_rad
        covariance = self.covariance + np.outer(by_height, by_height)
        covariance[CENTRE, CENTRE] += by_roll_m**2 + camera.lens_std_m**2
        covariance[WIDTH, WIDTH] += camera.lens_std_m**2
        return covariance

    @cached_property
    def features(self) -> dict[str, float]:
        """What the confidence depends on, by name; see `lanes.detect.confidence`."""
        far_seen = [far for far in self.far_evidence if far is not None]
        return lane_features(
            self.model,
            self.fit_covariance,
            self.curvature_per_m,
            [line.support for line in self.evidence],
            clear_share=self.clear_share,
            single_image_pose=self.single_image_pose,
            same_lane_share=self.same_lane_share,
            far_lines=len(far_seen),
            camera_yaw_rad=self.camera_yaw_rad or 0.0,
            usual_width=self.usual_width,
        )

    @property
    def log_odds_terms(self) -> dict[str, float]:
        """What contributes to `log_odds`, by name.

        The constant includes `confidence_shift`.
        """
        terms = {}
        for name, value in self.features.items():
            terms[name] = WEIGHTS[name] * value
        terms["constant"] += self.confidence_shift
        return terms

    @property
    def log_odds(self) -> float:
        """Logarithm of the odds that the lane is correct."""
        return sum(self.log_odds_terms.values())

    @cached_property
    def confidence(self) -> float:
        """Probability that both lines are within 0.2 m of the true ones, 5 to 30 m
        ahead, or up to `confident_to_m`.
        """
        return float(1 / (1 + np.exp(-self.log_odds)))

    @cached_property
    def confident_to_m(self) -> float:
        """Distance ahead up to which the confidence holds: 30 m, or less if the
        standard deviation of a line (RMS from 5 m on, given the camera pose) exceeds
        0.2 m beyond; 0 if it does everywhere.
        """
        variance = lateral_std_m(self.covariance, CORRECT_AT_M) ** 2
        points = np.arange(1, len(CORRECT_AT_M) + 1)
        rms_m = np.sqrt(variance.cumsum(axis=1) / points).max(axis=0)
        held = CORRECT_AT_M[rms_m <= CORRECT_WITHIN_M]
        return float(held.max(initial=0.0))

    @property
    def camera_offset_m(self) -> float:
        """Position of the camera left of the middle of the car."""
        return self.camera.offset_m if self.camera else 0.0

    @property
    def offset_m(self) -> float:
        """Position of the middle of the car left of the lane centre."""
        return float(-self.model[CENTRE]) - self.camera_offset_m

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
        """Curvature of the lane centre at the car; positive for a left bend."""
        curvature = self.model[CURVATURE]
        return float(curvature / (1 - curvature * self.model[CENTRE]))

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
        return float(np.sqrt(self.total_covariance[parameter, parameter]))

    @cached_property
    def lines(self) -> tuple[Line, Line]:
        """The left and the right line."""
        left, right = self.evidence
        return self._line(LEFT_SIDE, left), self._line(RIGHT_SIDE, right)

    def _line(self, side: float, evidence: LineEvidence) -> Line:
        return Line(
            side=side,
            model=self.model,
            covariance=self.total_covariance,
            **vars(evidence),
        )

    @property
    def left(self) -> Line:
        """The left line."""
        return self.lines[0]

    @property
    def right(self) -> Line:
        """The right line."""
        return self.lines[1]

    @property
    def ends_m(self) -> tuple[float, float]:
        """Distances of the farthest markings of the left and the right line.

        An inferred line ends with the other.
        """
        farthest_m = max(self.left.reach_m, self.right.reach_m)
        left_m = self.left.reach_m if self.left.seen else farthest_m
        right_m = self.right.reach_m if self.right.seen else farthest_m
        return left_m, right_m

    @cached_property
    def adjacent(self) -> tuple[Line | None, Line | None]:
        """The far lines of the adjacent lanes to the left and to the right.

        None for a line that is not seen. A lane that is uncertain or predicted has
        none. A tracker sees them in its searches, once a second, and states those that
        two searches or more found; in between `reach_m` is the end that was seen last.
        Type and support are those of one image.
        """
        if self.state in (COASTING, FROZEN) or self.confidence < LIKELY_CONFIDENCE:
            return None, None
        left, right = self.far_evidence
        return self._far_line(LEFT_SIDE, left), self._far_line(RIGHT_SIDE, right)

    def _far_line(self, side: float, evidence: LineEvidence | None) -> Line | None:
        if evidence is None:
            return None
        # from the centres of double lines, as they were fitted
        A = adjacent_lane_matrix(side)
        covariance = A @ self.total_covariance @ A.T
        return Line(
            side=side, model=A @ self.centres, covariance=covariance, **vars(evidence)
        )

    def lateral_m(self, x_m: np.ndarray) -> np.ndarray:
        """Lateral positions (2, N) of both lines at distances (N,), metres; as
        `Line.y`.

        Left line first.
        """
        return np.array([line.y(x_m) for line in self.lines])

    def lateral_std_m(self, x_m: np.ndarray) -> np.ndarray:
        """Standard deviations (2, N) of `lateral_m`, metres."""
        return np.array([line.std_m(x_m) for line in self.lines])

    def outlines(self, camera: Camera) -> list[np.ndarray]:
        """`Line.pixels` of the left and of the right line."""
        lines = project_lines(self.model, SIDES, camera, OUTLINE_M)
        return [visible_part(pixels) for pixels in lines]

    def columns(self, camera: Camera, rows: np.ndarray) -> np.ndarray:
        """Columns (2, rows) of the left and the right line at rows of the raw image; -2
        where they do not pass.
        """
        return columns_at(rows, self.outlines(camera), camera)

    def describe_bend(self) -> str:
        """The bend in words, with regard to its standard deviation; see
        `lanes.describe.describe_bend`.
        """
        return describe_bend(self.curvature_per_m, self.curvature_std_per_m)

    def describe_reach(self) -> str:
        """Words after the confidence: " up to 15 m" if it does not hold up to 30 m."""
        reach_m = self.confident_to_m
        if reach_m == CORRECT_AT_M[-1]:
            return ""
        return f" up to {reach_m:.0f} m" if reach_m else ", not to 0.2 m"

    def summary(self) -> dict[str, str]:
        """The lane in words, by name.

        The names are state, confidence, offset, bend, heading, width, left line, right
        line, and, if they are known, speed and warning.
        """
        curvature_per_km = 1e3 * self.curvature_per_m
        std_per_km = 1e3 * self.curvature_std_per_m
        per_km = f"{curvature_per_km:.2f} ± {std_per_km:.2f} per km"
        words = {
            "state": self.state,
            "confidence": f"{self.confidence:.0%}{self.describe_reach()}",
            "offset": describe_offset(self.offset_m, self.offset_std_m),
            "bend": f"{self.describe_bend()} ({per_km})",
            "heading": describe_heading(self.heading_rad),
            "width": f"{self.width_m:.2f} ± {describe_std(self.width_std_m)} m",
            "left line": self.left.describe(),
            "right line": self.right.describe(),
        }
        if self.car:
            words |= self.car.summary()
        return words

    def __repr__(self) -> str:
        words = self.summary()
        numbers = f"{words['offset']}, {self.describe_bend()}, {words['width']} wide"
        return f"Lane({self.state}, confidence {self.confidence:.2f}, {numbers})"


def stated(lane: Lane | None) -> Lane | None:
    """The lane, or None if its confidence is below `LEAST_CONFIDENCE`: no lane.

    Searches and tracks go on with such a lane; users get none.
    """
    if lane is None or lane.confidence < LEAST_CONFIDENCE:
        return None
    return lane


def columns_at(
    rows: np.ndarray, outlines: Sequence[np.ndarray], camera: Camera
) -> np.ndarray:
    """Columns (K, rows) of K outlines, pixels (N, 2) each, at rows of the image.

    They are -2 where an outline does not pass. A line ends where it runs almost along
    the rows, see `MAX_COLUMNS_PER_ROW`.
    """
    columns = np.full((len(outlines), len(rows)), NO_COLUMN)
    for k, outline in enumerate(outlines):
        if len(outline):
            # rows ascend, as np.interp wants them
            upwards = outline[: _end_in_rows(outline, camera)][::-1]
            columns[k] = np.interp(
                rows, upwards[:, 1], upwards[:, 0], left=NO_COLUMN, right=NO_COLUMN
            )
    inside = (columns >= 0) & (columns <= camera.width - 1)
    return np.where(inside, columns, NO_COLUMN)


def _end_in_rows(outline: np.ndarray, camera: Camera) -> int:
    """Number of points of an outline (N, 2) before it runs almost along the rows."""
    across, up = np.abs(np.diff(outline, axis=0)).T
    ends = outline[1:]
    inside = ((ends >= 0) & (ends < camera.size)).all(axis=1)
    is_flat = inside & (across > MAX_COLUMNS_PER_ROW * up)
    return int(np.append(is_flat, True).argmax()) + 1


def project_lines(
    model: np.ndarray, sides: np.ndarray, camera: Camera, along_m: np.ndarray
) -> np.ndarray:
    """Raw pixels (S, N, 2) of parallels to the path of a lane (15,).

    They are at arc lengths (N,); NaN outside of the lens. Those of the `sides` (S,) +1
    and -1 are the left and the right line; 0 is the middle between them.
    """
    points = np.empty((len(sides), len(along_m), 3))
    points[..., :2] = line_points(model, sides, along_m)
    points[..., 2] = road_height(model, points[..., 0])

    pose = camera.require_pose()
    pitch_rad = pose.pitch_rad + float(model[PITCH])
    pitched = camera.with_pose(replace(pose, pitch_rad=pitch_rad))
    pixels = pitched.road_to_pixels(points.reshape(-1, 3))
    return pixels.reshape(*points.shape[:2], 2)


def visible_part(pixels: np.ndarray) -> np.ndarray:
    """The points (N, 2) of a line, nearest first, while they rise in the image, without
    NaN at the beginning.
    """
    if not len(pixels):
        return pixels
    pixels = pixels[int(np.isfinite(pixels[:, 0]).argmax()) :]
    # the border of a lens shows the beginning of a far line above its continuation
    falls = np.append(pixels[1:, 1] >= pixels[:-1, 1], False)
    pixels = pixels[int(falls.argmin()) :]
    # comparisons with NaN are False: a point outside the lens ends the line
    rises = pixels[1:, 1] < pixels[:-1, 1]
    end = len(pixels) if rises.all() else int(rises.argmin()) + 1
    return pixels[: end if end > 1 else 0]
