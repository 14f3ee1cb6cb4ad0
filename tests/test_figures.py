"""Figures: their files, and no side effects on style or open figures."""

from __future__ import annotations

import matplotlib

matplotlib.use("Agg")

import matplotlib.pyplot as plt  # noqa: E402
import numpy as np  # noqa: E402
import pytest  # noqa: E402

from lanes import figures  # noqa: E402
from lanes.images import read_image  # noqa: E402


@pytest.fixture(autouse=True)
def close_figures():
    yield
    plt.close("all")


def figure_of_red():
    """A figure whose left half is red and whose right half is black."""
    image = np.zeros((72, 128, 3), np.uint8)
    image[:, :64] = (255, 0, 0)
    figure, (axis,) = figures.new_figure(1, 1, (6, 3))
    axis.imshow(image)
    return figure


@pytest.mark.parametrize("name", ["figure.jpg", "figure.png"])
def test_writes_a_picture_light_and_the_same_each_time(tmp_path, name):
    path, written = tmp_path / "new" / name, []
    for _ in range(2):
        written.append(figures.save_figure(figure_of_red(), path).read_bytes())
    assert written[0] == written[1]
    assert len(written[0]) < 60_000
    picture = read_image(path)
    assert picture.shape[1] == 480
    assert [p.name for p in path.parent.iterdir()] == [name]
    # Red is red: the file holds RGB, not BGR.
    assert picture[picture.shape[0] // 2, 150, 0] > 200 > 50 > picture[picture.shape[0] // 2, 150, 2]


def test_unwritable_figures(tmp_path):
    (tmp_path / "file").write_text("not a folder")
    figure = figure_of_red()
    with pytest.raises(ValueError, match=r"figure\.svg: .*\.jpg or \.png"):
        figures.save_figure(figure, tmp_path / "figure.svg")
    with pytest.raises(OSError, match=r"figure\.jpg: cannot be written"):
        figures.save_figure(figure, tmp_path / "file" / "figure.jpg")
