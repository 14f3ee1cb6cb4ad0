"""Whole drives: a video, some stills or a live camera in; annotated pictures, telemetry and a report out."""
