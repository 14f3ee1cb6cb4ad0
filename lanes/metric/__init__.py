"""The metric path: paint evidence, one model for both lines, a tracker that knows its doubt."""
