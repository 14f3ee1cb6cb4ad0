"""Exercises of chapters 9 to 12: metres, the filter for paint, one model for both
lines, the Kalman filter.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from course.exercises.hints import (
    HintError,
    require,
    require_equal,
    require_shape,
    tried,
)
from course.plots import LEGEND_ABOVE, TRUTH_LOOK
from lanes.camera.model import Camera, CameraPose
from lanes.canvas import LANE_COLOUR, LEFT_COLOUR, RIGHT_COLOUR
from lanes.show.figures import new_figure, rgb

if TYPE_CHECKING:
    from matplotlib.axes import Axes

# 9.1: height of the camera, width and distance of a lane, metres, and by how many
# degrees the assumed pitch is too large. Cameras of a car and a lorry; the view looks
# too far down and too far up.
PITCH_ERRORS = (
    (1.30, 3.66, 30.0, 0.3),
    (1.30, 3.66, 30.0, -0.3),
    (2.40, 3.00, 18.0, 1.0),
    (1.55, 3.75, 42.0, -0.2),
)
# Largest relative error of the answer. The small-angle formula is within 0.2 % of the
# camera's projection.
PITCH_TOLERANCE = 0.02
PITCH_FORMULA = (
    " degrees. The ray falls by h / X' in the view, and by h / X on the road. Compare "
    "the "
    "two; take height and width from the arguments."
)


def check_pitch_error(
    pitch_error_deg: Callable[[float, float, float, float], float],
) -> str:
    """9.1: the pitch error that makes a lane look too narrow or too wide, degrees."""
    height_m, width_m, _, true = np.array(PITCH_ERRORS).T
    seen = np.array([_seen(*case) for case in PITCH_ERRORS])
    seen_width_m, seen_at_m = seen.T
    found = np.empty(len(PITCH_ERRORS))
    for k in range(len(found)):
        answer = pitch_error_deg(seen_width_m[k], seen_at_m[k], height_m[k], width_m[k])
        one = "return one number, the error in degrees"
        found[k] = require_shape(tried(answer), (), one)

    ratio = width_m / seen_width_m
    mistakes = {
        "; your answer is in radians. Use np.degrees.": np.radians(true),
        "; the sign is wrong. If the lane looks too narrow, the assumed pitch is too "
        "large.": -true,
        "; distance_m is the distance in the view, X'. The true one is X = X' w / "
        "w'.": (true * ratio),
        "; the ratio of the widths is upside down. If w' < w, the true distance is "
        "larger "
        "than X'.": -true * ratio,
        "; the height is missing: the ray falls by h / X, not by 1 / X.": true
        / height_m,
    }
    said = (
        f"a lane {width_m[0]} m wide that looks {seen_width_m[0]:.2f} m wide at "
        f"{seen_at_m[0]:.1f} m: yours is {found[0]:.3f}, true {true[0]:.3f}"
    )
    require_equal(found, true, mistakes, PITCH_FORMULA, said=said, rtol=PITCH_TOLERANCE)
    return (
        f"{len(true)} errors from {true.min()} to {true.max()} degrees are right "
        "within "
        f"{PITCH_TOLERANCE:.0%}."
    )


def _seen(
    height_m: float, width_m: float, distance_m: float, error_deg: float
) -> tuple[float, float]:
    """The width of the lane in the view, and the distance that the view
    shows, metres.
    """
    pose = CameraPose(height_m, pitch_rad=np.radians(1.5))
    camera = Camera.from_fov((1280, 720), 60, pose)
    pitch_rad = pose.pitch_rad + np.radians(error_deg)
    assumed = camera.with_pose(replace(pose, pitch_rad=pitch_rad))

    left = (distance_m, width_m / 2)
    right = (distance_m, -width_m / 2)
    pixels = camera.road_to_pixels(np.array([left, right]))
    (seen_at_m, left_m), (_, right_m) = assumed.pixels_to_road(pixels)
    return left_m - right_m, seen_at_m


# 10.1: cells at either end of a row that do not count, and the position of the stripe.
MARGIN = 40
PLACE = 150
# Gray levels of the road, and of the contrast of paint and seams.
ROAD = 120.0
CONTRAST = 60.0
# Largest error, as a share of the score of a stripe.
RESPONSE_TOLERANCE = 0.1
Respond = Callable[[np.ndarray, int], np.ndarray]


class ResponseCase(NamedTuple):
    """A row with a stripe of a width in cells, and what to think of if it is wrong.

    The largest score of the cells `counted` is compared.
    """

    name: str
    row: np.ndarray
    width: int
    counted: slice
    advice: str


def _response_cases() -> list[ResponseCase]:
    middle = slice(PLACE, PLACE + 1)
    shadow = _row(1, contrast=0.0)
    shadow[PLACE - 30 : PLACE + 30] -= CONTRAST  # with edges of both kinds
    return [
        ResponseCase(
            "a bright stripe",
            _row(3),
            3,
            middle,
            "Subtract the road from the stripe, and divide by 1 + n, where n is the "
            "mean "
            "over 51 cells.",
        ),
        ResponseCase(
            "a dark seam",
            _row(3, contrast=-CONTRAST),
            3,
            middle,
            "It is no paint: take no absolute value.",
        ),
        ResponseCase(
            "an edge of a shadow",
            shadow,
            3,
            ALL_CELLS,
            "Subtract the larger of the two sides: max(m_l, m_r).",
        ),
        ResponseCase(
            "a double line 7 cells wide",
            _row(7),
            7,
            middle,
            "The width decides over the mean in the centre and over the distance of "
            "the "
            "strips of road.",
        ),
        ResponseCase(
            "a cell beside a stripe",
            _row(3),
            3,
            ALL_CELLS,
            "Check gap, strips and noise.",
        ),
    ]


ALL_CELLS = slice(MARGIN, -MARGIN)


def check_stripe_response(respond: Respond) -> str:
    """10.1: the response of the band filter along one row."""
    tried(respond(_row(3), 3))
    tolerance = RESPONSE_TOLERANCE * _respond(_row(3), 3)[PLACE]
    reached = []
    for case in _response_cases():
        found = _scores_of(respond, case)
        expected = _respond(case.row, case.width)
        largest = float(found[case.counted].max())
        _require_score(case, largest, float(expected[case.counted].max()), tolerance)
        if case.name == "a cell beside a stripe":
            off = np.abs(found - expected)[ALL_CELLS]
            worst = int(off.argmax()) + MARGIN
            _require_score(case, float(found[worst]), float(expected[worst]), tolerance)
        reached.append(largest)
    stripe, seam, edge, *_ = reached
    return (
        f"a stripe scores {stripe:.1f}, an edge at most {max(edge, 0):.1f}, a seam "
        f"{seam:.1f}."
    )


def _scores_of(respond: Respond, case: ResponseCase) -> np.ndarray:
    found = np.asarray(respond(case.row.copy(), case.width), float)
    require(
        found.shape == case.row.shape,
        f"the result has shape {found.shape}; it needs one number for each cell, "
        f"{case.row.shape}.",
    )
    require(np.isfinite(found[ALL_CELLS]).all(), "some scores are NaN or infinite.")
    return found


def _require_score(
    case: ResponseCase, score: float, right: float, tolerance: float
) -> None:
    require(
        abs(score - right) <= tolerance,
        f"{case.name} scores {score:.1f} instead of {right:.1f}. {case.advice}",
    )


def _row(width: int, *, contrast: float = CONTRAST) -> np.ndarray:
    """A row of the road with a stripe in the middle."""
    row = ROAD + np.random.default_rng(10).normal(0, 2, 2 * PLACE + 1)
    row[PLACE - width // 2 : PLACE + width // 2 + 1] += contrast
    return row


def _respond(row: np.ndarray, width: int) -> np.ndarray:
    """The response as the course defines it."""
    centre = _mean(row, width)
    road = _mean(row, 3)
    reach = width // 2 + 3
    brighter_side = np.maximum(np.roll(road, reach), np.roll(road, -reach))
    steps = np.abs(np.diff(row, prepend=row[0]))
    return (centre - brighter_side) / (1 + _mean(steps, 51))


def _mean(values: np.ndarray, count: int) -> np.ndarray:
    return np.convolve(values, np.ones(count) / count, mode="same")


# 11.1: centre (m), heading (rad) and curvature (1/m) of a lane, their tolerances, and
# its width (m).
LANE = np.array([0.25, -0.012, 0.002])
LANE_TOLERANCES = np.array([0.03, 0.004, 2e-4])
WIDTH_M = 3.66
# Another lane, on the left of the car: both of its lines have a positive y.
OTHER_CENTRE_M = 2.5
OTHER_WIDTH_M = 3.0
KnownWidthFit = Callable[[np.ndarray, np.ndarray, np.ndarray, float], np.ndarray]


def check_known_width(fit: KnownWidthFit) -> str:
    """11.1: the lane from one of its lines, with a known width."""
    x_m = np.geomspace(5.0, 30.0, 80)
    noise_m = np.random.default_rng(11).normal(0, 0.02, len(x_m))
    every = np.ones(len(x_m), bool)

    # the left line alone, then the right one alone
    left = _fit_lane(fit, LANE, WIDTH_M, x_m, every, noise_m)
    _require_left(left)
    right = _fit_lane(fit, LANE, WIDTH_M, x_m, ~every, noise_m)
    _require_lane(
        right,
        LANE,
        "with the left line it is right, but not with the right line, where `left` is "
        "False.",
    )

    # another lane, beside the car
    other = np.array([OTHER_CENTRE_M, *LANE[1:]])
    for side in (every, ~every):
        found = _fit_lane(fit, other, OTHER_WIDTH_M, x_m, side, noise_m)
        _require_lane(
            found,
            other,
            f"in a lane {OTHER_WIDTH_M} m wide beside the car it is wrong. Use width_m "
            "and "
            f"left, not {WIDTH_M} m and the sign of y.",
        )

    # candidates of the left line that are 0.5 m off, few, and cannot decide alone
    both_x_m = np.geomspace(5.0, 30.0, 400)
    few = np.arange(len(both_x_m)) % 100 == 0
    off_m = np.where(few, 0.5, 0.0)
    mixed = _fit_lane(fit, LANE, WIDTH_M, both_x_m, few, off_m)
    _require_lane(
        mixed,
        LANE,
        "with candidates of both lines it is wrong: each of them counts, with its own "
        "half "
        "width.",
    )
    worst_m = max(abs(left[0] - LANE[0]), abs(right[0] - LANE[0]))
    return f"with one line the centre is off by {100 * worst_m:.1f} cm at most."


def _require_left(found: np.ndarray) -> None:
    """The lane from its left line: name the usual mistakes."""
    half_m = WIDTH_M / 2
    mistakes = {
        "the curvature is half of the true one: use x^2 / 2.": LANE * [1, 1, 0.5],
        f"the centre lies {half_m:.2f} m too far left: this is the line. Use the "
        "width.": (LANE + [half_m, 0, 0]),
        f"the centre lies {half_m:.2f} m too far right: it is half a width from either "
        "line.": LANE - [half_m, 0, 0],
        f"the centre lies {WIDTH_M:.2f} m too far left: it is on the wrong side of the "
        "left line. To the right y is smaller.": LANE + [WIDTH_M, 0, 0],
    }
    centre_m, heading_rad, curvature_per_m = found
    otherwise = (
        f"centre {centre_m:.2f} m, heading {heading_rad:.3f} rad, curvature "
        f"{1e3 * curvature_per_m:.1f} 1/km; true are {LANE[0]} m (left is positive), "
        f"{LANE[1]} rad and {1e3 * LANE[2]:.1f} 1/km."
    )
    require_equal(found, LANE, mistakes, otherwise, atol=LANE_TOLERANCES)


def _require_lane(found: np.ndarray, lane: np.ndarray, otherwise: str) -> None:
    require_equal(found, lane, {}, otherwise, atol=LANE_TOLERANCES)


def _fit_lane(
    fit: KnownWidthFit,
    lane: np.ndarray,
    width_m: float,
    x_m: np.ndarray,
    left: np.ndarray,
    off_m: np.ndarray,
) -> np.ndarray:
    """The answer for candidates (N,), each on one of the lines, `off_m` beside it.

    They are on the left line where `left` is True, else on the right one.
    """
    centre_m, heading_rad, curvature_per_m = lane
    shape_m = heading_rad * x_m + curvature_per_m * x_m**2 / 2
    from_centre_m = np.where(left, width_m / 2, -width_m / 2)
    y_m = centre_m + from_centre_m + shape_m + off_m
    answer = tried(fit(x_m.copy(), y_m, left.copy(), width_m))
    what = "return the centre, the heading and the curvature"
    return require_shape(answer, (3,), what)


# 12.1: the mean squared distance of three quantities is 3 if all covariances are right.
MEAN_DISTANCE = (2.8, 3.2)


def check_noise(
    factor: float, *, try_noise: Callable[[float], tuple[float, float]]
) -> str:
    """12.1: a factor on Q with which the innovations of three numbers are consistent.

    Their mean squared distance is then about 3. `try_noise` gives this mean, and the
    RMS error of the offset in cm, for a factor.
    """
    is_number = not np.ndim(factor) and np.isfinite(factor)
    require(is_number and factor > 0, "give one positive number, the factor on Q.")
    distance, error_cm = try_noise(float(factor))
    reached = f"with {factor:g} Q the mean d^2 is {distance:.2f}"
    least, most = MEAN_DISTANCE
    require(
        distance <= most,
        f"{reached}: the filter is too sure. A larger Q makes it less sure.",
    )
    require(
        distance >= least,
        f"{reached}: the filter is too unsure. A smaller Q makes it surer.",
    )
    if np.isnan(error_cm):
        return f"{reached}."
    return f"{reached}, and the RMS error of the offset {error_cm:.1f} cm."


# 12.2: 99 % of the right measurements of three quantities have a smaller squared
# Mahalanobis distance (chi-squared).
GATE = 11.34
# A state of offset, heading and curvature, and a measurement of the offset and the
# heading alone.
STATE = np.array([0.2, 0.01, 0.001])
P = np.array([[4e-4, 2e-5, 0], [2e-5, 1e-5, 1e-7], [0, 1e-7, 4e-8]])
H = np.eye(3)[:2]
R = np.array([[9e-4, 1e-5], [1e-5, 4e-6]])
Correct = Callable[..., tuple[np.ndarray, np.ndarray]]


def check_gate(correct_state: Correct) -> str:
    """12.2: the correct step with a gate, on single measurements and drawn
    for a drive.
    """
    drive = filter_drive(correct_state)
    if drive:
        draw_filtered_drive(drive)
    _check_near(correct_state)
    _check_distances(correct_state)
    return "the filter takes what fits and skips the neighbouring lane."


def _check_near(correct_state: Correct) -> None:
    """A measurement that fits."""
    near = STATE[:2] + [0.03, 0.002]
    try:
        found = tried(_call(correct_state, near))
    except ValueError as error:
        if "shape" not in str(error) and "dimension" not in str(error):
            raise
        raise HintError(
            f"the shapes do not match ({error}). H is not square here: S = H P H^T + "
            "R, "
            "K = P H^T S^-1."
        ) from error
    require(
        _is_step(found),
        "return two values: the state (3,) and its covariance P (3, 3).",
    )
    state, covariance = found
    expected, expected_P = _correct(near)
    distance = _distance(near)
    rejected = (
        f"a measurement that is {distance:.1f} away (squared) is rejected; it fits."
    )
    otherwise = (
        f"the offset becomes {state[0]:.4f} instead of {expected[0]:.4f}: "
        "state + K (z - H state)."
    )
    require_equal(state, expected, {rejected: STATE}, otherwise, atol=1e-6)
    unchanged = (
        "the state is right, but P is not updated: a measurement makes it smaller, "
        "P - K H P."
    )
    otherwise = "the state is right, but P is not P - K H P."
    require_equal(
        covariance, expected_P, {unchanged: P}, otherwise, rtol=1e-3, atol=1e-12
    )


def _check_distances(correct_state: Correct) -> None:
    """Measurements, some of them outside the gate, at known distances."""
    std = np.sqrt(np.diag(H @ P @ H.T + R))
    step = np.array([0.6, 0.8]) * std
    for squared in (6.0, 10.5, 12.5, 30.0, 200.0):
        scale = np.sqrt(squared / _distance(STATE[:2] + step))
        found = _call(correct_state, STATE[:2] + step * scale)
        at = f"d^2 = {squared:.1f}"
        require(
            found is not None,
            f"None is returned at {at}. Return the state and P, both unchanged if "
            "rejected.",
        )
        require(
            _is_step(found),
            f"at {at} return two values, too: the state (3,) and its covariance P (3, "
            "3).",
        )
        accepted = not np.allclose(found[0], STATE, atol=1e-9)
        require(
            not accepted or squared < GATE,
            f"a measurement with {at} is accepted. Above 11.3 return state and P "
            "unchanged. Compare d^2 = nu^T S^-1 nu, not its root.",
        )
        require(
            accepted or squared > GATE,
            f"a measurement with {at} is rejected. Use the inverse of S = H P H^T + R, "
            "not "
            "R alone, and not the diagonal of S.",
        )
    is_unchanged = np.allclose(found[1], P, atol=1e-12)
    require(is_unchanged, "a rejected measurement must leave P as it is, too.")


def _is_step(found: object) -> bool:
    """Whether a state (3,) and a covariance (3, 3) were returned."""
    return isinstance(found, (tuple, list)) and [np.shape(part) for part in found] == [
        (3,),
        (3, 3),
    ]


def _call(correct_state: Correct, z: np.ndarray) -> Any:
    return correct_state(STATE.copy(), P.copy(), z.copy(), R.copy(), H.copy())


def _correct(z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    S = H @ P @ H.T + R
    K = P @ H.T @ np.linalg.inv(S)
    return STATE + K @ (z - H @ STATE), P - K @ H @ P


def _distance(z: np.ndarray) -> float:
    """Squared Mahalanobis distance of a measurement from its prediction."""
    innovation = z - H @ STATE
    S = H @ P @ H.T + R
    return float(innovation @ np.linalg.solve(S, innovation))


# 12.2, the drive that is drawn: a filter is tried on measurements of which some are of
# the neighbouring lane. Measurements, seconds between two of them, and speed.
COUNT = 100
STEP_S = 0.1
SPEED_MPS = 27.0
# How many are of the neighbouring lane, and how far that is.
WRONG_COUNT = 10
LANE_M = 3.7
# As in chapter 12, states are (offset, heading, curvature). Measurements are (left +
# right, heading): H is not square.
DRIVE_F = np.array([[1, -SPEED_MPS * STEP_S, 0], [0, 1, 0], [0, 0, 1]])
DRIVE_H = np.diag([-2.0, 1, 1])[:2]
DRIVE_Q = np.diag([0.03, 0.02, 0.005]) ** 2 * STEP_S
FIRST_P = np.diag([1, 0.05, 0.005]) ** 2
NOISE_STD = np.array([0.15, 0.006])


@dataclass(frozen=True, eq=False)
class FilteredDrive:
    """A drive of N frames: true, measured and filtered offset, its standard deviation,
    and what was accepted.
    """

    times_s: np.ndarray
    true_m: np.ndarray
    measured_m: np.ndarray
    accepted: np.ndarray
    offset_m: np.ndarray
    std_m: np.ndarray


def draw_filtered_drive(drive: FilteredDrive) -> None:
    """12.2: the offset over time, all of it and enlarged."""
    figure, axes = new_figure(2, 1, (12, 6), sharex=True)
    for axis, limit_m in zip(axes, (4.6, 0.8), strict=True):
        _draw_filtered(axis, drive)
        axis.set(ylabel="offset (m)", ylim=(-limit_m, limit_m))
        axis.grid(alpha=0.3)
    title = "10 % of the measurements are of the neighbouring lane"
    axes[0].set_title(title, loc="left")
    axes[0].legend(ncols=4, **LEGEND_ABOVE)
    axes[1].set_title("Enlarged", loc="left")
    axes[1].set_xlabel("time (s)")


def _draw_filtered(axis: Axes, drive: FilteredDrive) -> None:
    # a filter that diverges leaves the axes, whose limits are fixed
    offset_m = np.clip(drive.offset_m, -99, 99)
    band_m = np.minimum(2 * drive.std_m, 99)
    blue = rgb(RIGHT_COLOUR)
    axis.fill_between(
        drive.times_s,
        offset_m - band_m,
        offset_m + band_m,
        color=blue,
        alpha=0.25,
        linewidth=0,
    )
    label = "your filter, ± 2 standard deviations"
    axis.plot(drive.times_s, offset_m, color=blue, label=label)
    axis.plot(drive.times_s, drive.true_m, label="truth", **TRUTH_LOOK)

    looks = {"accepted": (".", LANE_COLOUR), "rejected": ("x", LEFT_COLOUR)}
    for name, (marker, colour) in looks.items():
        chosen = drive.accepted == (name == "accepted")
        axis.plot(
            drive.times_s[chosen],
            drive.measured_m[chosen],
            marker,
            color=rgb(colour),
            markersize=7,
            label=name,
        )


def filter_drive(correct_state: Correct) -> FilteredDrive | None:
    """The drive filtered with a correct step.

    None if the step raises an error or returns other shapes.
    """
    true_m, measurements = simulate_drive()
    state = np.zeros(3)
    covariance = FIRST_P
    accepted = []
    offset_m = []
    std_m = []
    for z in measurements:
        state = DRIVE_F @ state
        covariance = DRIVE_F @ covariance @ DRIVE_F.T + DRIVE_Q
        corrected = _try_step(correct_state, state, covariance, z)
        if corrected is None:
            return None
        new_state, covariance = corrected
        accepted.append(not np.array_equal(new_state, state))
        state = new_state
        offset_m.append(state[0])
        std_m.append(np.sqrt(max(covariance[0, 0], 0)))
    return FilteredDrive(
        times_s=np.arange(COUNT) * STEP_S,
        true_m=true_m,
        measured_m=-measurements[:, 0] / 2,
        accepted=np.array(accepted),
        offset_m=np.array(offset_m),
        std_m=np.array(std_m),
    )


def _try_step(
    correct_state: Correct, state: np.ndarray, covariance: np.ndarray, z: np.ndarray
) -> tuple[np.ndarray, np.ndarray] | None:
    """The corrected state (3,) and covariance (3, 3); None if they are
    something else.
    """
    noise = np.diag(NOISE_STD**2)
    try:
        with np.errstate(all="ignore"):
            found = correct_state(
                state.copy(), covariance.copy(), z.copy(), noise, DRIVE_H.copy()
            )
        new_state, new_covariance = (np.asarray(part, float) for part in found)
    except Exception:  # the code of the reader may raise anything
        return None
    if new_state.shape != (3,) or new_covariance.shape != (3, 3):
        return None
    return new_state, new_covariance


def simulate_drive() -> tuple[np.ndarray, np.ndarray]:
    """True offsets (N,), metres, and measurements (N, 2)."""
    rng = np.random.default_rng(12)
    heading = 0.01 * np.sin(np.arange(COUNT) * STEP_S)
    offset_m = 0.3 - SPEED_MPS * STEP_S * np.cumsum(heading)
    states = np.column_stack([offset_m, heading, np.zeros(COUNT)])
    measurements = states @ DRIVE_H.T + rng.normal(0, NOISE_STD, (COUNT, 2))

    # not the first ones, with which the filter finds the lane
    wrong = rng.choice(np.arange(5, COUNT), WRONG_COUNT, replace=False)
    side = rng.choice([-1, 1], WRONG_COUNT)
    measurements[wrong, 0] += 2 * LANE_M * side
    return offset_m, measurements
