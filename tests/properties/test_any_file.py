"""For any content of a text file: its reader returns valid data, or raises one sentence
that names the file.
"""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from lanes.camera.model import CalibrationReport, camera_to_dict, load_camera
from lanes.errors import CameraError
from lanes.files import read_telemetry
from lanes.labels import LaneColumns, read_labels, read_predictions
from lanes.score import score_still
from tests.support.examples import examples
from tests.support.labelme_files import labelme_file, line_strip
from tests.support.painted_drive import CAMERA

# Values that replace parts of a valid file.
ODD = (
    st.none()
    | st.booleans()
    | st.text(max_size=5)
    | st.lists(st.integers(), max_size=2)
    | st.just({})
    | st.integers()
    | st.floats()
    | st.sampled_from([0, -1, 1e-320, 1e308, "1e3", 2**70, float("nan"), "nan", "~"])
)


def lists_and_objects(inner: st.SearchStrategy) -> st.SearchStrategy:
    names = st.text(max_size=4)
    return st.lists(inner, max_size=3) | st.dictionaries(names, inner)


JSON = st.recursive(ODD, lists_and_objects, max_leaves=5)
LABEL = {
    "raw_file": "a.jpg",
    "h_samples": [400, 410, 420, 430],
    "lanes": [[1, 2, 3, 4], [-2, 7, 8, 9]],
}
LEFT = line_strip("left", (3, 400), (1, 720))
LABELME = labelme_file("a.jpg", (640, 720), [LEFT])
TELEMETRY = "frame,time_s,state,offset_m\n0,0.0,tracking,0.1\n1,0.04,lost,\n"


def paths_into(content: object, *before: object) -> list[tuple]:
    """The key sequences of all values in nested dicts and lists."""
    if isinstance(content, list):
        content = dict(enumerate(content))
    if not isinstance(content, dict):
        return []
    paths = []
    for key, value in content.items():
        path = (*before, key)
        paths += [path, *paths_into(value, *path)]
    return paths


@st.composite
def damaged(draw: st.DrawFn, content: dict) -> dict:
    """The content with up to three values replaced or removed."""
    content = json.loads(json.dumps(content))
    for _ in range(draw(st.integers(1, 3))):
        *way, last = draw(st.sampled_from(paths_into(content)))
        holder = content
        for key in way:
            holder = holder[key]
        if draw(st.booleans()):
            holder[last] = draw(ODD)
        else:
            del holder[last]
        if not paths_into(content):
            break
    return content


@st.composite
def garbled(draw: st.DrawFn, text: str) -> bytes:
    """The text with some bytes replaced, removed or repeated; or random bytes."""
    data = text.encode()
    for _ in range(draw(st.integers(1, 4))):
        place = st.integers(0, len(data))
        begin, end = sorted([draw(place), draw(place)])
        repeated = st.just(data[begin:end] * 2)
        new = draw(st.binary(max_size=6) | repeated)
        data = data[:begin] + new + data[end:]
    return draw(st.just(data) | st.binary(max_size=40))


def encoded(content: dict) -> bytes:
    return json.dumps(content).encode()


@pytest.fixture(scope="module")
def path(tmp_path_factory) -> Path:
    return tmp_path_factory.mktemp("any") / "file with a name"


def read_or_refused(read, path: Path, data: bytes, error=ValueError):
    """Result of the reader; None if it refuses the file with a sentence."""
    path.write_bytes(data)
    try:
        return read(path)
    except error as refusal:
        sentence = str(refusal)
    assert sentence.startswith(f"{path}: ")
    assert "\n" not in sentence
    return None


REPORT = CalibrationReport(0.2, {"a.jpg": 0.2}, {}, "2026-01-01")
CAMERA_FILE = camera_to_dict(replace(CAMERA, report=REPORT))
CAMERA_YAML = yaml.safe_dump(CAMERA_FILE)
DAMAGED_CAMERA = damaged(CAMERA_FILE).map(yaml.safe_dump).map(str.encode)


@examples(60)
@given(DAMAGED_CAMERA | garbled(CAMERA_YAML))
def test_camera_files(path, data):
    camera = read_or_refused(load_camera, path, data, CameraError)
    if camera is not None:
        assert np.isfinite(camera.matrix).all()
        assert np.isfinite(camera.distortion).all()
        assert min(camera.size) > 0
        assert "nan" not in repr(camera)


def json_lines(rows: list) -> bytes:
    return b"\n".join(map(encoded, rows))


ANY_LABELS = st.lists(damaged(LABEL) | JSON, max_size=3).map(json_lines)
ANY_LABELS |= garbled(json.dumps(LABEL))
TRUE_LABEL = LaneColumns(
    LABEL["raw_file"],
    np.array(LABEL["h_samples"], float),
    np.array(LABEL["lanes"], float),
)


def assert_has_an_ego_lane(lanes: LaneColumns) -> None:
    columns = lanes.ego_lane((1280, 720)).columns
    assert columns.shape == (2, len(lanes.rows))


def assert_can_be_scored(lanes: LaneColumns, label: LaneColumns) -> None:
    accuracy, *_ = score_still(lanes, label).values["ego accuracy"]
    assert 0 <= accuracy <= 1 or len(lanes.rows)


@examples(60)
@given(ANY_LABELS)
def test_labels_in_json_lines(path, data):
    for label in read_or_refused(read_labels, path, data) or ():
        assert_has_an_ego_lane(label)
        assert_can_be_scored(label, TRUE_LABEL)
        assert_can_be_scored(TRUE_LABEL, label)


@examples(60)
@given(ANY_LABELS)
def test_predictions_in_json_lines(path, data):
    def read(file: Path) -> list[LaneColumns]:
        return read_predictions(file, [TRUE_LABEL])

    for lanes in read_or_refused(read, path, data) or ():
        assert_has_an_ego_lane(lanes)
        assert_can_be_scored(lanes, TRUE_LABEL)
        assert_can_be_scored(TRUE_LABEL, lanes)


@examples(60)
@given(damaged(LABELME).map(encoded) | garbled(json.dumps(LABELME)))
def test_lanes_of_labelme(path, data):
    for lanes in read_or_refused(read_labels, path, data) or ():
        assert lanes.columns.shape == (len(lanes.columns), len(lanes.rows))
        assert np.isfinite(lanes.columns).all()
        assert_has_an_ego_lane(lanes)


@examples(40)
@given(garbled(TELEMETRY))
def test_telemetry(path, data):
    columns = read_or_refused(read_telemetry, path, data)
    if columns is not None:
        assert "frame" in columns
        assert len({len(column) for column in columns.values()}) == 1
