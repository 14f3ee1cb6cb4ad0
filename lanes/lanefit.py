import numpy as np
from dataclasses import dataclass, replace

# order of the parameters
CENTRE, WIDTH, HEADING, CURVATURE, RATE, PITCH = range(6)


def flatten_pitch(x, y, pitch, height):
    stretch = np.maximum(1 + pitch * x / height, 0.2)
    return x / stretch, y / stretch


def distance_to_arc(x, y, heading, curvature):
    sin, cos = np.sin(heading), np.cos(heading)
    along = 2 * (y * cos - x * sin) - curvature * (x * x + y * y)
    return along / (1 + np.sqrt(np.maximum(1 - curvature * along, 0)))


def arc_y(x, offset, heading, curvature):
    """y at x of the curve at `offset` left of the arc; NaN where folded"""
    m = 1 - curvature * offset
    sin, k = np.sin(heading) / m, curvature / m
    root = np.sqrt(np.maximum(m * m - np.sin(heading) ** 2, 0))
    c0 = offset * (2 - curvature * offset) / (np.cos(heading) + root)
    q = sin + k * x
    inside = np.abs(q) < 0.995
    y = c0 + x * (sin + q) / (root / m + np.sqrt(np.maximum(1 - q * q, 1e-4)))
    return np.where(inside, y, np.nan)


@dataclass(frozen=True)
class Prior:
    mean: np.ndarray
    std: np.ndarray

PRIOR = Prior(np.array([0.0, 3.5, 0, 0, 0, 0]), np.array([0.8, 0.5, 0.15, 0.05, 2e-3, 0.015]))


def flatten_angle(x, y, angle, pitch, height):
    stretch = np.maximum(1 + pitch * x / height, 0.2)
    return np.arctan(stretch * np.tan(angle) - pitch / height * y)


def confidence(stripes):
    s2 = stripes.strength**2
    return s2 / (s2 + 36)


def residuals(p, x, y, side, height):
    xs, ys = flatten_pitch(x, y, p[PITCH], height)
    a = distance_to_arc(xs, ys, p[HEADING], p[CURVATURE])
    return a - p[RATE] * xs**3 / 6 - p[CENTRE] - side * p[WIDTH] / 2


def angle_agreement(p, x, y, angle, height, std=0.1):
    xs, ys = flatten_pitch(x, y, p[PITCH], height)
    a = distance_to_arc(xs, ys, p[HEADING], p[CURVATURE])
    sin = (np.sin(p[HEADING]) + p[CURVATURE] * xs) / np.maximum(1 - p[CURVATURE] * a, 0.1) + p[RATE] * xs**2 / 2
    miss = np.arcsin(np.clip(sin, -1, 1)) - flatten_angle(x, y, angle, p[PITCH], height)
    return 1 / (1 + (miss / std) ** 2) ** 2


STEP = np.array([0.01, 0.01, 1e-4, 1e-5, 1e-7, 1e-5])


def jacobian(p, x, y, side, height):
    cols = [-np.ones_like(x), -side / 2]
    for k in range(HEADING, 6):
        d = np.zeros(6)
        d[k] = STEP[k]
        cols.append((residuals(p + d, x, y, side, height) - residuals(p - d, x, y, side, height)) / (2 * STEP[k]))
    return np.column_stack(cols)


def nearest_side(p, x, y, height):
    a = residuals(p, x, y, 0.0, height)
    return np.where(a >= 0, 1.0, -1.0)

GROW = ((14, 3), (18, 3), (23, 2.5), (30, 2), (38, 2), (48, 1.5), (60, 1.2), (70, 1), (70, 1))

def fit(p, stripes, sigma, height, prior=PRIOR, schedule=GROW):
    """IRLS; returns p, cov, weights, side"""
    x, y = stripes.x_m, stripes.y_m
    conf = confidence(stripes)
    for far, s in schedule:
        side = nearest_side(p, x, y, height)
        r = residuals(p, x, y, side, height)
        z = r / (sigma * s)
        robust = angle_agreement(p, x, y, stripes.angle, height) / (1 + z * z) ** 2
        use = (robust > 0.02) & (x < far)
        w = (conf * robust / (sigma * s)**2)[use]
        J = jacobian(p, x[use], y[use], side[use], height)
        A = J.T @ (J * w[:, None]) + np.diag(1 / prior.std**2)
        b = J.T @ (w * r[use]) + (p - prior.mean) / prior.std**2
        p = p - np.linalg.solve(A, b)
        p[CURVATURE] = np.clip(p[CURVATURE], -0.12, 0.12)
        p[PITCH] = np.clip(p[PITCH], -0.06, 0.06)
    cov = np.linalg.inv(A)
    side = nearest_side(p, x, y, height)
    r = residuals(p, x, y, side, height)
    robust = angle_agreement(p, x, y, stripes.angle, height) / (1 + (r / sigma) ** 2) ** 2
    return p, cov, conf * robust, side
