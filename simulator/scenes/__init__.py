"""Scenes: the course's stills and videos, and the benchmark suite."""
