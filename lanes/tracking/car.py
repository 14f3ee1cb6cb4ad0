"""The car: its four variables in the Kalman state, general parameters of cars, and the estimated motion.

The variables are the curvature of the steered path, the speed, the pitch at rest between bumps, and the yaw of the
camera relative to the direction of motion. None of them is measured. They are estimated from the motion of the lane.
Where they have no effect on it (the speed, straight ahead in the lane centre) they stay uncertain.
"""

from __future__ import annotations

from dataclasses import dataclass

from lanes.tracking.model import PARAMETERS

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
    """How the car moves in its lane.

    Attributes
    ----------
    speed_mps : float
    path_per_m : float
        Curvature of the path that the car steers, positive left.
    course_rad : float
        Direction of motion of the camera, seen from it, positive left.
    turning_std_per_m : float
        Standard deviation of the lane's curvature minus that of the path.
    course_std_rad : float
        Standard deviation of the lane's heading minus the course.
    """

    speed_mps: float
    path_per_m: float = 0.0
    course_rad: float = 0.0
    turning_std_per_m: float = 0.0
    course_std_rad: float = 0.0


def lever_m(speed_mps: float) -> float:
    """Distance from the camera back to the point of the car that moves along the car's longitudinal axis."""
    return CAR_PARAMETERS.lever_m * max(0.0, 1 - (speed_mps / CAR_PARAMETERS.tangent_mps) ** 2)
