"""The lane tracker in metres: bird's-eye view, marking response, model fit, Kalman filter."""
