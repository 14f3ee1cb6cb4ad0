"""The sketch of the sign conventions."""

from __future__ import annotations

from course.sketch import sketch_conventions


def test_three_views_name_every_quantity():
    _, axes = sketch_conventions()
    assert [axis.get_title() for axis in axes] == ["From above", "From the side", "From behind"]
    text = " ".join(note.get_text() for axis in axes for note in axis.texts)
    for quantity in ("x forward", "y left", "z up", "offset > 0", "heading > 0", "curvature > 0"):
        assert quantity in text
    for angle in ("yaw > 0", "pitch > 0", "roll > 0"):
        assert angle in text
