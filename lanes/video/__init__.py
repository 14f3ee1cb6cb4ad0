"""Videos and telemetry: read, annotate, write."""
