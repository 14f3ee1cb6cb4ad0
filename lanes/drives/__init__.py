"""Whole drives: sources, camera pose, tracking, overlay, telemetry and report."""
