"""The benchmark's figures: what is on the axes."""

from __future__ import annotations

import matplotlib

matplotlib.use("Agg")

import matplotlib.pyplot as plt  # noqa: E402
import numpy as np  # noqa: E402
import pytest  # noqa: E402

from benchmark.reporting import figures  # noqa: E402


@pytest.fixture(autouse=True)
def close_figures():
    yield
    plt.close("all")


class TestRanges:
    def test_marks_are_at_the_second_end_and_at_the_edge_where_it_lies_beyond(self):
        ends = {"a": (np.array([0.1, 0.2]), np.array([0.5, np.inf])), "b": (np.array([0.1, np.nan]),) * 2}
        figure, (axis, share) = figures.plot_ranges(
            ["hill", "dale"], {"error (m)": ends, "share": ends}, limits={"error (m)": (0.01, 10), "share": (0, 1)}
        )
        assert (axis.get_xscale(), share.get_xscale()) == ("log", "linear")
        assert [text.get_text() for text in axis.get_yticklabels()] == ["hill", "dale"]
        assert axis.yaxis_inverted()
        first, second = axis.lines
        assert first.get_xdata().tolist() == [0.5, 10]
        assert np.isnan(second.get_xdata()[1])
        # side by side, not on top of each other
        assert (first.get_ydata() < second.get_ydata()).all()
        assert [text.get_text() for text in figure.legends[0].get_texts()] == ["a", "b"]


def test_both_variants_of_a_recipe_have_one_colour_and_one_shape():
    looks = figures.marker_looks(["hls_sobel", "hls_sobel_pose", "tracker"])
    published, from_pose, tracker = looks.values()
    assert from_pose == {**published, "markerfacecolor": "none"}
    assert published["markerfacecolor"] == published["color"] != tracker["color"]
    assert published["marker"] != tracker["marker"]


class TestReliability:
    def test_dots_whiskers_and_counts(self):
        bins = tuple(np.array(v) for v in ([0.3, 0.95], [0.5, 1.0], [0.2, 0.9], [0.8, 1.0], [10, 200]))
        curves = {"engine": (np.array([0.2, 0.9]), np.array([1.0, 0.8])), "recipe": (np.array([1.0]), np.array([0.4]))}
        _, (left, right) = figures.plot_reliability(bins, curves)
        assert [text.get_text() for text in left.texts] == ["10", "200"]
        assert left.lines[0].get_xdata().tolist() == [0, 1]
        whiskers = left.collections[0].get_segments()
        assert [segment[:, 1].tolist() for segment in whiskers] == [
            pytest.approx([0.2, 0.8]),
            pytest.approx([0.9, 1.0]),
        ]
        engine, recipe = right.lines
        assert (engine.get_linestyle(), recipe.get_linestyle(), recipe.get_marker()) == ("-", "None", "s")
