"""The lane over time: an extended Kalman filter in metres with a state machine.

    picture -> extract_evidence -> predict -> update -> describe       (once a second: search as without memory)

The estimate of a frame uses that frame and all earlier ones. It is not smoothed, so that it follows the beginning of a
bend without delay.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lanes.camera.camera import Camera
from lanes.io.describe import html_table
from lanes.io.frames import Frame
from lanes.tracking.birdseye import BirdsEyeView
from lanes.tracking.detector import search_lane
from lanes.tracking.lane import Lane
from lanes.tracking.markings import extract_evidence
from lanes.tracking.track import Track, start_track, update_track
from lanes.tracking.tracked_lane import COASTING, LOST, SEARCHING, TRACKING, TrackedLane


@dataclass(frozen=True)
class TrackerParameters:
    """State machine of the tracker; tuned on the rendered suite where no source is given."""

    # Smallest score (sum of the square roots of both lines' supports) of a detection that starts a track, and the
    # number of consecutive detections that confirm it.
    min_score: float = 0.45
    confirmations: int = 3
    # Longest time in which the lane is not seen.
    max_coast_s: float = 1.0
    # Period of searches while tracking. A track is given up after this number of consecutive searches that found
    # another lane whose score is larger by this margin.
    search_period_s: float = 1.0
    rival_margin: float = 0.1
    objections: int = 3
    # Period, in frames, in which the profile of each line is measured, left and right in turn: they seldom change.
    profile_period: int = 10
    # Period of fits outwards on a smooth road: some metres of a drive.
    outwards_period_s: float = 0.25
    # Two lanes are the same if their lines lie within this at these distances.
    same_lane_m: float = 0.3
    same_lane_at_m: tuple[float, ...] = (6.0, 12.0, 20.0)
    # Half widths of the views while tracking: the narrowest is used that contains both lines at these distances with
    # this margin.
    half_widths_m: tuple[float, ...] = (3.0, 4.0, 5.0, 9.0, 13.0)
    view_margin_m: float = 0.8
    view_lines_at_m: tuple[float, ...] = (5.0, 20.0, 35.0)


TRACKER = TrackerParameters()
_VIEW_LINES_AT_M, _SAME_LANE_AT_M = np.array(TRACKER.view_lines_at_m), np.array(TRACKER.same_lane_at_m)


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
        self.view = BirdsEyeView(camera)
        self.fps, self.speed_mps = fps, speed_mps
        self._views = tuple(BirdsEyeView(camera, half_width_m=half) for half in TRACKER.half_widths_m)
        self.reset()

    def reset(self) -> None:
        """Forget everything, as between two drives."""
        self._track: Track | None = None
        self._state = LOST
        self._confirmed = self._objections = self._regained = self._since_search = 0
        self._unseen_s, self._margin = 0.0, 0.0

    def summary(self) -> dict[str, str]:
        """Settings and current result in words, by name."""
        camera = self.view.camera
        speed = "estimated" if self.speed_mps is None else f"{3.6 * self.speed_mps:.0f} km/h, given"
        settings = {"camera": f"{camera.width}x{camera.height} px, {camera.pose.height_m:.2f} m above the road"}
        return settings | {"pictures a second": f"{self.fps:g}", "speed": speed} | self._result().summary()

    def __repr__(self) -> str:
        camera = self.view.camera
        return f"LaneTracker({camera.width}x{camera.height} px, {self.fps:g} pictures a second, {self._state})"

    def _repr_html_(self) -> str:
        return html_table("LaneTracker", self.summary())

    def update(self, image: Frame, *, elapsed_s: float | None = None) -> TrackedLane:
        """Process the next picture.

        Parameters
        ----------
        image : ndarray of shape (height, width, 3), uint8, or YuvFrame
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
            self.reset()
        self._since_search += 1
        search = self._search_is_due()
        view = self.view if search else self._narrowest_view()
        evidence = extract_evidence(image, view)
        if self._track is not None:
            track = update_track(
                self._track,
                evidence,
                view,
                elapsed_s=elapsed_s,
                speed_mps=self.speed_mps,
                margin=self._margin,
                outwards=self._outwards_is_due(),
                profiles_of=self._profiles_due(),
            )
            self._follow(track, elapsed_s)
        if search:
            found = search_lane(evidence, self.view)
            self._compare(found)
        return self._result()

    def _search_is_due(self) -> bool:
        period = TRACKER.search_period_s * self.fps
        return self._state != TRACKING or self._objections > 0 or self._since_search >= period

    def _narrowest_view(self) -> BirdsEyeView:
        """The narrowest view that contains both lines."""
        reach_m = max(np.abs(line.y(_VIEW_LINES_AT_M)).max() for line in self._track.lane.lines)
        wide_enough = (view for view in self._views if reach_m < view.half_width_m - TRACKER.view_margin_m)
        return next(wide_enough, self._views[-1])

    def _outwards_is_due(self) -> bool:
        """Whether the lane may be fitted outwards in this frame on a smooth road, too."""
        return self._since_search % max(round(TRACKER.outwards_period_s * self.fps), 1) == 0

    def _profiles_due(self) -> tuple[int, ...]:
        """Lines whose profile is measured in this frame: left (0), right (1) or none."""
        phase = self._since_search % TRACKER.profile_period
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
            self.reset()
        else:
            self._state, self._regained = COASTING, 0

    def _compare(self, found: Lane | None) -> None:
        """Compare a lane detected without memory with the track: start, confirm it, or object to it."""
        self._since_search = 0
        known = self._track and self._track.lane
        if found is None or found.score < TRACKER.min_score:
            self._objections = 0
        elif known is not None and same_lane(found, known):
            self._confirm(found)
        elif known is None:
            self._start(found)
        elif self._state != TRACKING or found.score > known.score + TRACKER.rival_margin:
            self._object(found)
        else:
            self._objections = 0

    def _confirm(self, found: Lane) -> None:
        """The search found the tracked lane."""
        self._objections, self._margin = 0, found.margin
        self._confirmed += 1
        if self._confirmed >= TRACKER.confirmations and self._state == SEARCHING:
            self._state = TRACKING

    def _object(self, found: Lane) -> None:
        """The search found another lane: start with it if the track is not confirmed, or after several objections."""
        self._objections += 1
        self._margin = self._track.lane.score - found.score
        if self._state == SEARCHING or self._objections >= TRACKER.objections:
            self._start(found)

    def _start(self, lane: Lane) -> None:
        """Start a track with a detected lane."""
        self.reset()
        self._track = start_track(lane, self.speed_mps)
        self._state, self._confirmed, self._margin = SEARCHING, 1, lane.margin

    def _result(self) -> TrackedLane:
        if self._track is None:
            return TrackedLane(LOST)
        left, right = (votes.marking_type for votes in self._track.votes)
        return TrackedLane(self._state, self._track.lane, self._track.estimate.motion, (left, right))


def same_lane(found: Lane, known: Lane) -> bool:
    """Whether both lines of a detected lane are those of the known one."""
    y, known_y = found.lateral_m(_SAME_LANE_AT_M), known.lateral_m(_SAME_LANE_AT_M)
    # lines of a hairpin may turn back before these distances: NaN counts as the same
    return not (np.abs(y - known_y) > TRACKER.same_lane_m).any()
