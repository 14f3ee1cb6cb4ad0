"""The scenes: the embedded pictures and videos, and the benchmark suite."""
