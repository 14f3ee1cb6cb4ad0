"""Access to the operating system: files, pictures, videos, telemetry, terminal, threads."""
