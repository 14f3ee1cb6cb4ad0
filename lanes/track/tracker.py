"""The lane over time: an extended Kalman filter in metres with a state machine.

    picture -> extract_evidence -> predict -> update -> describe

Once a second (every five seconds if the track is sure), and while the lane is doubtful, the frame is also searched as
without memory. Stripes that never move (`lanes.track.static_pattern`) are left out.

The estimate of a frame uses that frame and all earlier ones. It is not smoothed, so that it follows the beginning of a
bend without delay.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from lanes.camera import Camera
from lanes.describe import html_table
from lanes.detect.birdseye import BirdsEyeView
from lanes.detect.confidence import SURE_CONFIDENCE, log_odds, rate_lane
from lanes.detect.lane import Lane
from lanes.detect.line_type import MarkingType
from lanes.detect.paint import FrameEvidence, extract_evidence
from lanes.detect.road import lateral_std_m
from lanes.detect.search import search_lane
from lanes.track.departure import DepartureWarning, watch_departure
from lanes.track.filter import CarMotion, Track, start_track, update_track
from lanes.track.static_pattern import StaticPattern

SEARCHING, TRACKING, COASTING, LOST = "searching", "tracking", "coasting", "lost"
# State of a lane detected in a single picture.
FOUND = "found"


@dataclass(frozen=True)
class TrackerParameters:
    """State machine of the tracker; tuned on the rendered suite where no source is given."""

    # Smallest score (sum of the square roots of both lines' supports) of a detection that starts a track, and the
    # number of consecutive detections that confirm it. While a track has less, or a smaller confidence than this, every
    # frame is searched.
    min_score: float = 0.45
    confirmations: int = 3
    min_confidence: float = 0.2
    # Longest time in which the lane is not seen.
    max_coast_s: float = 1.0
    # Period of searches while tracking: of a track that is not sure, and of one that is (`SURE_CONFIDENCE`). A track is
    # given up after this number of consecutive searches that found another lane whose score is larger by this margin,
    # or the logarithm of whose odds to be correct is.
    search_period_s: float = 1.0
    sure_search_period_s: float = 5.0
    rival_margin: float = 0.1
    rival_log_odds: float = 3.0
    objections: int = 3
    # Period, in frames, in which the profile of each line is measured, left and right in turn: they seldom change.
    profile_period: int = 10
    # Period of fits outwards on a smooth road: some metres of a drive.
    outwards_period_s: float = 0.25
    # Two lanes are the same if their lines lie within this number of the known one's standard deviations of each other,
    # but never farther apart than the larger of these limits, and always if nearer than the smaller one.
    same_lane_stds: float = 3.0
    same_lane_m: tuple[float, float] = (0.15, 0.3)
    same_lane_at_m: tuple[float, ...] = (6.0, 12.0, 20.0)
    # Half widths of the views while tracking: the narrowest is used that contains both lines at these distances with
    # this margin.
    half_widths_m: tuple[float, ...] = (3.0, 4.0, 5.0, 9.0, 13.0)
    view_margin_m: float = 0.8
    view_lines_at_m: tuple[float, ...] = (5.0, 20.0, 35.0)
    # Shortest time between samples of the static pattern, and the width of its columns: stripes within 1 to 2 columns
    # are at the same place.
    static_period_s: float = 0.5
    static_column_m: float = 0.02


TRACKER = TrackerParameters()
_VIEW_LINES_AT_M, _SAME_LANE_AT_M = np.array(TRACKER.view_lines_at_m), np.array(TRACKER.same_lane_at_m)


@dataclass(frozen=True, eq=False)
class TrackedLane:
    """The lane in one frame of a drive.

    Attributes
    ----------
    state : str
        "tracking": seen in this frame and before; "searching": seen, not yet confirmed; "coasting": not seen now and
        predicted from before, or seen again in fewer than `TRACKER.confirmations` frames; "lost": unknown, `lane` is
        None; "found": detected in a single picture.
    lane : Lane or None
        In metres, with standard deviations.
    motion : CarMotion or None
        Speed, path and course of the car; the speed is given, or estimated from the motion of the lane. None if lost,
        and in a single picture.
    marking_types : (MarkingType, MarkingType)
        Colour, pattern, double: left and right.
    """

    state: str
    lane: Lane | None = None
    motion: CarMotion | None = None
    marking_types: tuple[MarkingType, MarkingType] = (MarkingType(), MarkingType())

    @classmethod
    def from_still(cls, lane: Lane | None) -> TrackedLane:
        """A lane detected in a single picture; lost where none was found."""
        return cls(LOST) if lane is None else cls(FOUND, lane)

    @cached_property
    def confidence(self) -> float:
        """Probability that both lines are correct within 0.2 m over 5 to 30 m ahead; 0 if lost."""
        return 0.0 if self.lane is None else rate_lane(self.lane, tracked=self.state != FOUND)

    @cached_property
    def warning(self) -> DepartureWarning | None:
        """Time to line crossing; None if lost, and in a single picture."""
        return None if self.lane is None or self.motion is None else watch_departure(self.lane, self.motion)

    def summary(self) -> dict[str, str]:
        """State, confidence, lane, speed and warning in words, by name."""
        words = {"state": self.state}
        if self.lane is None:
            return words
        words |= {"confidence": f"{self.confidence:.0%}"} | self.lane.summary()
        if self.motion is not None:
            words["speed"] = f"{3.6 * self.motion.speed_mps:.0f} km/h"
        if self.warning and (warning := self.warning.describe()):
            words["warning"] = warning
        return words

    def __repr__(self) -> str:
        return f"TrackedLane({self.state}, confidence {self.confidence:.2f}, {self.lane})"

    def _repr_html_(self) -> str:
        return html_table("Lane in this frame", self.summary())

    def as_row(self) -> dict[str, str | float | None]:
        """Telemetry of the frame, by column name; None where the lane is lost."""
        lane = self.lane
        row: dict[str, str | float | None] = {"state": self.state, "confidence": self.confidence}
        names = ("offset_m", "offset_std_m", "heading_rad", "curvature_per_m", "curvature_std_per_m")
        row |= {name: None if lane is None else getattr(lane, name) for name in names}
        row["lane_width_m"] = None if lane is None else lane.width_m
        row["pitch_rad"] = None if lane is None else lane.pitch_rad
        row["camera_yaw_rad"] = None if lane is None else lane.camera_yaw_rad
        for side in ("left", "right"):
            line = None if lane is None else getattr(lane, side)
            for name in ("c0_m", "c1", "c2_per_m", "c3_per_m2"):
                row[f"{side}_{name}"] = None if line is None else getattr(line, name)
        return row


class LaneTracker:
    """Tracks the lane through consecutive pictures of one camera.

    Parameters
    ----------
    camera : Camera
        With its pose.
    fps : float
        Pictures per second.
    speed_mps : float, optional
        Speed of the car; estimated if not given. Assign `tracker.speed_mps` when it changes.

    Raises
    ------
    ValueError
        If `fps` is not positive.
    """

    def __init__(self, camera: Camera, *, fps: float = 25.0, speed_mps: float | None = None) -> None:
        if not fps > 0:
            raise ValueError(f"a video has more than 0 pictures a second; got fps={fps}.")
        self.fps, self.speed_mps = fps, speed_mps
        self._views = tuple(BirdsEyeView(camera, half_width_m=half) for half in TRACKER.half_widths_m)
        self.view = self._views[TRACKER.half_widths_m.index(BirdsEyeView.half_width_m)]
        self.reset()

    def reset(self) -> None:
        """Forget everything, as between two drives."""
        widest = self._views[-1]
        self._static = StaticPattern(widest.shape[0], self._static_columns(widest.y_m)[-1] + 1)
        self._since_static_s, self._lane_moves = TRACKER.static_period_s, False
        self._forget_lane()

    def _forget_lane(self) -> None:
        """Search from scratch; what never moves in the pictures of this camera is still known."""
        self._track: Track | None = None
        self._state = LOST
        self._confirmed = self._objections = self._regained = self._since_search = self._frames = 0
        self._unseen_s = 0.0
        self._result = TrackedLane(LOST)

    def summary(self) -> dict[str, str]:
        """Settings and current result in words, by name."""
        camera = self.view.camera
        speed = "estimated" if self.speed_mps is None else f"{3.6 * self.speed_mps:.0f} km/h, given"
        settings = {"camera": f"{camera.width}x{camera.height} px, {self.view.height_m:.2f} m above the road"}
        return settings | {"pictures a second": f"{self.fps:g}", "speed": speed} | self._result.summary()

    def __repr__(self) -> str:
        camera = self.view.camera
        return f"LaneTracker({camera.width}x{camera.height} px, {self.fps:g} pictures a second, {self._state})"

    def _repr_html_(self) -> str:
        return html_table("LaneTracker", self.summary())

    def update(self, image: np.ndarray, *, elapsed_s: float | None = None) -> TrackedLane:
        """Process the next picture.

        Parameters
        ----------
        image : ndarray of shape (height, width, 3), uint8, RGB
            RGB, or as its video stores it; raw.
        elapsed_s : float, optional
            Time since the previous picture, if it is not 1 / fps (dropped frames). The tracker starts again if it is
            longer than `TRACKER.max_coast_s` or negative.

        Returns
        -------
        TrackedLane

        Raises
        ------
        PictureError
            If the picture is not RGB or not of the camera's size.
        """
        elapsed_s = 1 / self.fps if elapsed_s is None else elapsed_s
        if not 0 <= elapsed_s <= TRACKER.max_coast_s:
            self._forget_lane()
        self._since_search += 1
        self._since_static_s += max(elapsed_s, 0.0)
        self._frames += 1
        due = self._objections > 0 or self._is_weak() or self._since_search >= self._search_period_s() * self.fps
        search = due or self._state != TRACKING or self._is_doubtful()
        view = self.view if search or self._track is None else self._narrowest_view(self._track.lane)
        view_image = view.warp(image)
        evidence, found = self._without_static(extract_evidence(view_image, view), search=search)
        if self._track is not None:
            outwards_period = max(round(TRACKER.outwards_period_s * self.fps), 1)
            track = update_track(
                self._track,
                evidence,
                elapsed_s=elapsed_s,
                speed_mps=self.speed_mps,
                outwards=self._frames % outwards_period == 0,
                profiles_of=self._profiles_due(),
            )
            self._follow(track, elapsed_s)
        if search and self._replaced_by(found, by_paint=due) and found is not None:
            self._start(found)
        self._result = self._describe()
        return self._result

    def _search_period_s(self) -> float:
        """Period of searches for the present track."""
        sure = self._result.confidence >= SURE_CONFIDENCE
        return TRACKER.sure_search_period_s if sure else TRACKER.search_period_s

    def _is_weak(self) -> bool:
        """Whether there is a track with little support."""
        return self._track is not None and self._track.lane.score < TRACKER.min_score

    def _is_doubtful(self) -> bool:
        """Whether there is a track with little confidence."""
        return self._track is not None and self._result.confidence < TRACKER.min_confidence

    def _without_static(self, evidence: FrameEvidence, *, search: bool) -> tuple[FrameEvidence, Lane | None]:
        """The evidence without stripes that never move, and the lane that a `search` finds in it.

        Every `TRACKER.static_period_s` the evidence is a sample of what never moves. Nothing is left out unless a
        search finds a lane that moves: on a straight road without any sway, as in some simulators, solid lines do not
        move either.
        """
        stripes, y_m = evidence.stripes, evidence.view.y_m
        places = stripes.row, self._static_columns(stripes.y_m)
        static = self._static.is_static(*places)
        sample = self._since_static_s >= TRACKER.static_period_s
        if sample:
            first, last = self._static_columns(y_m[[0, -1]])
            self._static.add(*places, seen=slice(first, last + 1))
            self._since_static_s = 0.0
        if static.any():
            moving, lane = replace(evidence, stripes=stripes.select(~static)), None
            if search or (sample and not self._lane_moves):
                lane = search_lane(moving)
                found = lane is not None and lane.score >= TRACKER.min_score
                self._lane_moves = found or (self._lane_moves and self._state != LOST)
            if self._lane_moves:
                return moving, lane
        return evidence, search_lane(evidence) if search else None

    def _static_columns(self, y_m: np.ndarray) -> np.ndarray:
        """Columns of the static pattern at lateral positions."""
        return np.round((self._views[-1].y_m[0] - y_m) / TRACKER.static_column_m).astype(int)

    def _narrowest_view(self, lane: Lane) -> BirdsEyeView:
        """The narrowest view that contains both lines of a lane."""
        reach_m = max(np.abs(line.y(_VIEW_LINES_AT_M)).max() for line in lane.lines)
        wide_enough = (view for view in self._views if reach_m < view.half_width_m - TRACKER.view_margin_m)
        return next(wide_enough, self._views[-1])

    def _profiles_due(self) -> tuple[int, ...]:
        """Lines whose profile is measured in this frame: left (0), right (1) or none."""
        phase = self._frames % TRACKER.profile_period
        return (0,) if phase == 0 else (1,) if phase == TRACKER.profile_period // 2 else ()

    def _follow(self, track: Track, elapsed_s: float) -> None:
        """Take the updated track, coast on it if the lane is not seen, or give it up."""
        self._track = track
        if track.seen:
            self._unseen_s = 0.0
            self._regained += self._state == COASTING
            if self._regained >= TRACKER.confirmations:
                self._state, self._regained = TRACKING, 0
            return
        self._unseen_s += elapsed_s
        if self._state == SEARCHING or self._unseen_s > TRACKER.max_coast_s or not track.certain:
            self._forget_lane()
        else:
            self._state, self._regained = COASTING, 0

    def _replaced_by(self, found: Lane | None, *, by_paint: bool) -> bool:
        """Compare a lane detected without memory with the track: does a new track start with it?

        Unless `by_paint`, one with more paint does not count, only one that is much more probable.
        """
        if by_paint:
            self._since_search = 0
        if found is None or found.score < TRACKER.min_score:
            self._objections = 0
            return False
        if self._track is None:
            return True
        known = self._track.lane
        if same_lane(found, known):
            self._objections = 0
            self._confirmed += 1
            if self._confirmed >= TRACKER.confirmations and self._state == SEARCHING:
                self._state = TRACKING
            return False
        if self._state == TRACKING and not _is_rival(found, known, by_paint=by_paint):
            self._objections = 0
            return False
        # start with the other lane if the track is not confirmed, or after several objections
        self._objections += 1
        return self._state == SEARCHING or self._objections >= TRACKER.objections

    def _start(self, lane: Lane) -> None:
        """Start a track with a detected lane."""
        self._forget_lane()
        self._track = start_track(lane, self.speed_mps)
        self._state, self._confirmed = SEARCHING, 1

    def _describe(self) -> TrackedLane:
        if self._track is None:
            return TrackedLane(LOST)
        left, right = (line.votes.marking_type for line in self._track.lane.observations)
        return TrackedLane(self._state, self._track.lane, self._track.estimate.motion, (left, right))


def _is_rival(found: Lane, known: Lane, *, by_paint: bool) -> bool:
    """Whether a detected lane is much more probable than the tracked one, or, `by_paint`, better supported."""
    surer = log_odds(found) > log_odds(known, tracked=True) + TRACKER.rival_log_odds
    return surer or (by_paint and found.score > known.score + TRACKER.rival_margin)


def same_lane(found: Lane, known: Lane) -> bool:
    """Whether both lines of a detected lane are those of the known one."""
    y, known_y = found.lateral_m(_SAME_LANE_AT_M), known.lateral_m(_SAME_LANE_AT_M)
    std_m = lateral_std_m(known.assumed_covariance, _SAME_LANE_AT_M)
    tolerance_m = np.clip(TRACKER.same_lane_stds * std_m, *TRACKER.same_lane_m)
    # lines of a hairpin may turn back before these distances: NaN counts as the same
    return not (np.abs(y - known_y) > tolerance_m).any()
