"""Files, pictures, videos, telemetry, the terminal: everything that touches the operating system."""
