"""Reports of the scores: tables, figures, calibration of the confidence, list of failures."""
