"""For any content of a text file: its reader returns valid data, or raises one sentence that names the file."""

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
ODD = st.none() | st.booleans() | st.text(max_size=5) | st.lists(st.integers(), max_size=2) | st.just({})
ODD |= st.integers() | st.floats() | st.sampled_from([0, -1, 1e-320, 1e308, "1e3", 2**70, float("nan"), "nan", "~"])
JSON = st.recursive(
    ODD, lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=4), inner), max_leaves=5
)
LABEL = {"raw_file": "a.jpg", "h_samples": [400, 410, 420, 430], "lanes": [[1, 2, 3, 4], [-2, 7, 8, 9]]}
LABELME = labelme_file("a.jpg", (640, 720), [line_strip("left", (3, 400), (1, 720))])
TELEMETRY = "frame,time_s,state,offset_m\n0,0.0,tracking,0.1\n1,0.04,lost,\n"


def paths_into(content: object, *before: object) -> list[tuple]:
    """The key sequences of all values in nested dicts and lists."""
    inner = content.items() if isinstance(content, dict) else enumerate(content) if isinstance(content, list) else ()
    return [way for key, value in inner for way in ((*before, key), *paths_into(value, *before, key))]


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
    """The text with some of its bytes replaced, removed or repeated; or random bytes."""
    data = text.encode()
    for _ in range(draw(st.integers(1, 4))):
        begin, end = sorted(draw(st.tuples(*[st.integers(0, len(data))] * 2)))
        data = data[:begin] + draw(st.binary(max_size=6) | st.just(data[begin:end] * 2)) + data[end:]
    return draw(st.just(data) | st.binary(max_size=40))


@pytest.fixture(scope="module")
def path(tmp_path_factory) -> Path:
    return tmp_path_factory.mktemp("any") / "file with a name"


def assert_read_or_refused(read, path: Path, data: bytes, error: type[Exception] = ValueError):
    """Result of the reader; None if it refuses the file with a sentence."""
    path.write_bytes(data)
    try:
        return read(path)
    except error as refusal:
        assert str(refusal).startswith(f"{path}: ") and "\n" not in str(refusal)
        return None


CAMERA_FILE = camera_to_dict(replace(CAMERA, report=CalibrationReport(0.2, {"a.jpg": 0.2}, {}, "2026-01-01")))


@examples(60)
@given(
    damaged(CAMERA_FILE).map(lambda content: yaml.safe_dump(content).encode()) | garbled(yaml.safe_dump(CAMERA_FILE))
)
def test_camera_files(path, data):
    camera = assert_read_or_refused(load_camera, path, data, CameraError)
    if camera is not None:
        assert np.isfinite([*camera.matrix.ravel(), *camera.distortion, camera.largest_ray or 0]).any()
        assert np.isfinite(camera.matrix).all() and np.isfinite(camera.distortion).all()
        assert min(camera.size) > 0 and "nan" not in repr(camera)


@examples(60)
@given(
    st.lists(damaged(LABEL) | JSON, max_size=3).map(lambda rows: "\n".join(map(json.dumps, rows)).encode())
    | garbled(json.dumps(LABEL))
)
def test_lanes_in_json_lines(path, data):
    label = LaneColumns("a.jpg", np.array(LABEL["h_samples"], float), np.array(LABEL["lanes"], float))
    labels = assert_read_or_refused(read_labels, path, data) or ()
    found = assert_read_or_refused(lambda file: read_predictions(file, [label]), path, data) or ()
    for lanes in (*labels, *found):
        assert lanes.ego_lane((1280, 720)).columns.shape == (2, len(lanes.rows))
        for pair in ((lanes, label), (label, lanes)):
            assert 0 <= score_still(*pair).values["ego accuracy"][0] <= 1 or len(lanes.rows)


@examples(60)
@given(damaged(LABELME).map(lambda content: json.dumps(content).encode()) | garbled(json.dumps(LABELME)))
def test_lanes_of_labelme(path, data):
    for lanes in assert_read_or_refused(read_labels, path, data) or ():
        assert lanes.columns.shape == (len(lanes.columns), len(lanes.rows))
        assert np.isfinite(lanes.columns).all()
        assert lanes.ego_lane((1280, 720)).columns.shape == (2, len(lanes.rows))


@examples(40)
@given(garbled(TELEMETRY))
def test_telemetry(path, data):
    columns = assert_read_or_refused(read_telemetry, path, data)
    assert columns is None or ("frame" in columns and len({len(column) for column in columns.values()}) == 1)
