"""Found Roads: predictions of any program and of the engine are scored; what is
published.
"""

from __future__ import annotations

import json
import subprocess
from pathlib import Path

import numpy as np
import pytest
import yaml

from benchmark.real_roads import ways
from benchmark.real_roads.__main__ import main
from benchmark.real_roads.manifest import HERE, OFFICIAL_LABELS, VERSION, read_manifest
from benchmark.real_roads.published import describe_effect, published_sets
from benchmark.real_roads.sets import read_road_sets
from lanes.labels import LaneColumns, read_labels
from lanes.video.images import write_image
from tests.benchmark.test_labelled_stills import CAMERAS, write_lines, write_still
from tests.support.project import ROOT

STILLS = 3


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    """Labelled stills of two cameras."""
    folder = tmp_path_factory.mktemp("roads")
    entries = []
    for name, camera in CAMERAS.items():
        for number in range(STILLS):
            file = f"{name}/{number}.png"
            label = write_still(folder / file, camera, number / 5)
            entries.append({"raw_file": file} | label)
    write_lines(folder / "labels.jsonl", entries)
    return folder


def labels_of(folder: Path) -> list[dict]:
    return list(map(json.loads, (folder / "labels.jsonl").read_text().splitlines()))


def cells_of(printed: str, name: str) -> dict[str, str]:
    """The cells of the row `name` of the first table, by their headings."""
    headings, *rows = printed.splitlines()
    names = [" ".join(words) for words in map(str.split, headings.split("  ")) if words]
    (row,) = (row for row in rows if row.startswith(f"{name} "))
    return dict(zip(names, row.removeprefix(name).split(), strict=True))


def score(folder: Path, predictions: list[dict], *words: str) -> int:
    """Score predictions; the page is folder/page.html."""
    write_lines(folder / "lanes.jsonl", predictions)
    page = str(folder / "page.html")
    return main(["score", str(folder), str(folder / "lanes.jsonl"), "-o", page, *words])


def test_the_labels_as_predictions_are_all_right(folder, capsys):
    assert score(folder, labels_of(folder)) == 0
    out = capsys.readouterr().out
    cells = cells_of(out, "lanes AB")
    assert [cells[name] for name in ("points", "images", "right")] == [
        "1.000",
        "6",
        "6",
    ]
    assert cells["lines"] == cells["matched"] == "12"
    assert "no confidence is stated" in out


def test_the_mean_is_that_of_the_sets(folder, capsys):
    """One of three stills of a set has no prediction: 5/6, not 5/6 of the points."""
    high, *others = reversed(labels_of(folder))
    assert high["raw_file"].startswith("high")
    assert score(folder, others) == 0
    out = capsys.readouterr().out
    assert cells_of(out, "lanes AB")["points"] == "0.833"
    assert "worst set: high, 0.667 of the points" in out
    assert "1 of 6 stills have no prediction" in out


def test_a_stated_confidence_is_compared_with_the_right_lanes(folder, capsys):
    stated = [entry | {"confidence": 0.95} for entry in labels_of(folder)]
    stated[0]["lanes"] = [[1] * len(line) for line in stated[0]["lanes"]]
    assert score(folder, stated) == 0
    out = capsys.readouterr().out
    (row,) = (line for line in out.splitlines() if line.startswith("0.9 or more"))
    assert row.split()[3:6] == ["6", "5", "0.950"]


def test_the_page_shows_every_still(folder):
    score(folder, labels_of(folder))
    page = (folder / "page.html").read_text(encoding="utf-8")
    assert page.count("<figure>") == 2 * STILLS
    assert page.count("data:image/jpeg;base64,") == 2 * STILLS


def test_a_half_has_its_sets_only(folder, capsys):
    halves = {roads.name: roads.half for roads in read_road_sets(folder)}
    score(folder, labels_of(folder), "--half", halves["low"])
    out = capsys.readouterr().out
    printed = {name for name, half in halves.items() if f"{half} {name} " in out}
    assert printed == {name for name in halves if halves[name] == halves["low"]}


def test_a_half_without_a_set_is_named(tmp_path, capsys):
    entry = {"raw_file": "a/0.png", "h_samples": [1], "lanes": [[1], [2]]}
    write_lines(tmp_path / "labels.jsonl", [entry])
    (roads,) = read_road_sets(tmp_path)
    other = {"A": "B", "B": "A"}[roads.half]
    assert score(tmp_path, [entry], "--half", other) == 2
    assert "no labelled set is in this half" in capsys.readouterr().err


@pytest.mark.parametrize("name", ["lanes.jsonl", "labels.jsonl", "low/0.png"])
def test_an_input_is_not_overwritten(folder, name, capsys):
    write_lines(folder / "lanes.jsonl", labels_of(folder))
    before = (folder / name).read_bytes()
    words = [str(folder), str(folder / "lanes.jsonl"), "-o", str(folder / name)]
    assert main(["score", *words]) == 2
    assert "would be overwritten" in capsys.readouterr().err
    assert (folder / name).read_bytes() == before


@pytest.mark.slow
def test_the_lanes_of_the_engine_score_as_those_of_any_program(
    folder, tmp_path, capsys
):
    words = ["--only", "own", "-o", str(tmp_path)]
    assert main(["run", str(folder), *words]) == 0
    of_run = capsys.readouterr().out
    assert cells_of(of_run, "own AB")["right"] == "6"
    file = tmp_path / "own.jsonl"
    assert main(["score", str(folder), str(file), "-o", str(tmp_path / "a.html")]) == 0
    of_score = capsys.readouterr().out
    assert of_score.splitlines()[:-1] == of_run.splitlines()[:-1]


def test_a_way_that_no_set_has_is_said(folder, tmp_path, capsys):
    words = ["--only", "clips", "-o", str(tmp_path)]
    assert main(["run", str(folder), *words]) == 0
    assert capsys.readouterr().out == "clips: no set can be looked at in this way\n"


class TestOfficialLabels:
    """`official.jsonl` beside the labels: what is not ours to publish."""

    @pytest.fixture
    def roads(self, tmp_path) -> list:
        """A still whose right line is official, and one that is."""
        rows = [100, 110, 120, 130]
        none = [-2] * 4
        left = [10, 9, 8, 7]
        ours = {"raw_file": "a/0.png", "h_samples": rows, "lanes": [left, none]}
        right = [50, 51, 52, 53]
        both = {"h_samples": rows[1:], "lanes": [[1, 2, 3], right[1:]]}
        write_lines(tmp_path / "labels.jsonl", [ours])
        official = [{"raw_file": name} | both for name in ("a/0.png", "b/0.png")]
        write_lines(tmp_path / "official.jsonl", official)
        return read_road_sets(tmp_path)

    def test_a_line_that_a_label_lacks_is_added(self, roads):
        (label,) = roads[0].labels
        assert label.columns[1].tolist() == [-2, 51, 52, 53]

    def test_a_line_that_we_labelled_stays(self, roads):
        (label,) = roads[0].labels
        assert label.columns[0].tolist() == [10, 9, 8, 7]

    def test_a_still_without_our_label_is_added(self, roads):
        assert [one.name for one in roads] == ["a", "b"]


def test_an_entry_says_that_a_set_has_several_cameras(tmp_path):
    entry = {"raw_file": "a/0.png", "h_samples": [1], "lanes": [[1], [2]]}
    write_lines(tmp_path / "labels.jsonl", [entry | {"several_cameras": True}])
    (roads,) = read_road_sets(tmp_path)
    assert roads.several_cameras


# What is published.


def test_each_published_label_is_ours_and_has_a_source():
    whose = {source.file: source.labels for source in read_manifest()}
    for label in read_labels(HERE / "labels.jsonl"):
        assert whose[label.name] != OFFICIAL_LABELS
        if whose[label.name] != "by hand":
            assert whose[label.name] == "left by hand, right official"
            assert not (label.columns[1] >= 0).any()


def test_each_still_that_is_ours_has_a_label():
    labelled = {label.name for label in read_labels(HERE / "labels.jsonl")}
    ours = {one.file for one in read_manifest() if one.labels != OFFICIAL_LABELS}
    assert labelled == ours


def test_no_image_and_no_page_with_images_is_published():
    listed = ["git", "-C", str(ROOT), "ls-files", str(HERE)]
    files = subprocess.run(listed, capture_output=True, text=True).stdout.split()
    assert {Path(file).suffix for file in files} <= {".py", ".jsonl", ".md"}


def test_the_citation_has_the_version_of_the_benchmark():
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))
    assert citation["version"] == VERSION


def test_the_published_lanes_are_those_of_all_labels():
    sets, scored = published_sets("own")
    labels = [label.name for roads in sets for label in roads.labels]
    assert len(labels) == len(read_labels(HERE / "labels.jsonl"))
    found = [one.score.prediction for lanes in scored for one in lanes]
    assert [one.name for one in found] == labels


def test_the_effect_of_missing_stills_is_said():
    """Without all sets but one, the result is that of this set."""
    sets, _ = published_sets("own")
    (kept,) = (roads for roads in sets if roads.name == "india_scooter")
    *_, line = describe_effect({label.name for label in kept.labels}).splitlines()
    assert "the stills here: " in line
    assert "(mean of 1 sets)" in line
    assert line.endswith(f"of {len(kept.labels)} right")


def test_a_label_of_a_still_is_that_of_a_frame_of_another_size(tmp_path):
    """A clip of twice the width and three times the height; -2 is no point."""
    write_image(tmp_path / "a.png", np.zeros((360, 640, 3), np.uint8))
    columns = np.array([[100.0, -2.0]])
    label = LaneColumns("a.png", np.array([200.0, 300.0]), columns)
    of_frame = ways._at_size(tmp_path, label, (1280, 1080))
    assert of_frame.columns.tolist() == [[200.0, -2.0]]
    assert of_frame.rows.tolist() == [600.0, 900.0]
