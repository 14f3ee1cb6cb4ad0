"""State of the extended Kalman filter: 15 numbers of the lane, as in `lanes.tracking.model`, and four of the car.

The variables of the car are the curvature of the steered path, the speed, the pitch at rest between bumps, and the yaw
of the camera relative to the direction of motion. None of them is measured. They are estimated from the motion of the
lane. Where they have no effect on it (the speed, straight ahead in the lane centre) they stay uncertain.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lanes.tracking.model import ADJACENT, CENTRE, CURVATURE, HEADING, PARAMETERS, PRIOR_STD, WIDTH

PATH, SPEED, REST_PITCH, CAMERA_YAW = range(PARAMETERS, PARAMETERS + 4)
STATES = PARAMETERS + 4
LANE, CAR = slice(0, PARAMETERS), slice(PARAMETERS, STATES)


@dataclass(frozen=True)
class CarParameters:
    """Cars and their drivers; textbook values of passenger cars where no source is given."""

    # Distance of a camera behind the windscreen from the rear axle, metres.
    lever_m: float = 1.6
    # Tangent speed, 60 to 80 km/h for most cars: with the slip of the rear tyres the whole car points along its path.
    tangent_mps: float = 20.0
    # Speed where it is not given, and its standard deviation; standard deviation of a given speed (clock, speedometer).
    usual_speed_mps: float = 24.0
    usual_speed_std_mps: float = 8.0
    given_speed_std_mps: float = 0.5
    max_speed_mps: float = 70.0
    # Lateral acceleration that drivers accept in bends, and that tyres hold, m/s^2.
    usual_lateral_mps2: float = 3.0
    max_lateral_mps2: float = 6.0
    # Time constant with which the springs return the pitch to rest.
    pitch_relaxation_s: float = 0.3
    # Standard deviation of the pose's pitch and yaw: a quarter of a degree.
    rest_pitch_std_rad: float = 0.004
    camera_yaw_std_rad: float = 0.004


CAR_PARAMETERS = CarParameters()


@dataclass(frozen=True)
class CarMotion:
    """How the car moves in its lane."""

    speed_mps: float
    # Curvature of the path that the car steers, positive left.
    path_per_m: float = 0.0
    # Direction of motion of the camera, seen from it, positive left.
    course_rad: float = 0.0
    # Standard deviations of the lane's curvature minus that of the path, and of the lane's heading minus the course.
    turning_std_per_m: float = 0.0
    course_std_rad: float = 0.0


def lever_m(speed_mps: float) -> float:
    """Distance from the camera back to the point of the car that moves along the car's longitudinal axis."""
    return CAR_PARAMETERS.lever_m * max(0.0, 1 - (speed_mps / CAR_PARAMETERS.tangent_mps) ** 2)


@dataclass(frozen=True, eq=False)
class KalmanState:
    """Mean (19,) and covariance (19, 19) of lane and car."""

    mean: np.ndarray
    covariance: np.ndarray

    @property
    def lane(self) -> np.ndarray:
        """(15,) mean of the lane parameters."""
        return self.mean[LANE]

    @property
    def lane_covariance(self) -> np.ndarray:
        """(15, 15) covariance of the lane parameters."""
        return self.covariance[LANE, LANE]

    @property
    def motion(self) -> CarMotion:
        """Speed, path and course of the car, with standard deviations relative to the lane."""
        path, speed, camera_yaw = self.mean[[PATH, SPEED, CAMERA_YAW]].tolist()
        lever = lever_m(speed)
        return CarMotion(
            speed_mps=speed,
            path_per_m=path,
            course_rad=camera_yaw + lever * path,
            turning_std_per_m=self._std_of_sum({CURVATURE: 1.0, PATH: -1.0}),
            course_std_rad=self._std_of_sum({HEADING: 1.0, CAMERA_YAW: -1.0, PATH: -lever}),
        )

    def _std_of_sum(self, factors: dict[int, float]) -> float:
        """Standard deviation of a sum of state variables times factors."""
        indices, values = list(factors), np.array(list(factors.values()))
        return float(np.sqrt(values @ self.covariance[np.ix_(indices, indices)] @ values))

    def adjacent(self, side: float) -> KalmanState:
        """State of the adjacent lane to the left (+1) or right (-1), which shares a line with this one."""
        there, back = (ADJACENT.start, ADJACENT.start + 1) if side > 0 else (ADJACENT.start + 1, ADJACENT.start)
        jacobian = np.eye(STATES)
        jacobian[CENTRE, WIDTH], jacobian[CENTRE, there] = side, side / 2
        jacobian[WIDTH, there] = 1
        jacobian[[there, back]] = 0
        jacobian[back, there] = -1
        covariance = jacobian @ self.covariance @ jacobian.T
        covariance[there, there] = PRIOR_STD[there] ** 2
        return KalmanState(jacobian @ self.mean, covariance)
