"""The code of docs/own_loop.md runs and prints what the page says, with stand-ins for
ROS.
"""

from __future__ import annotations

import doctest
import re
import sys
from types import SimpleNamespace

import numpy as np
import pytest

from lanes.camera.model import save_camera
from lanes.video.reader import read_video
from tests.support.clips import FPS, write_clip
from tests.support.painted_drive import BENDS, SMALL
from tests.support.project import ROOT

logs = pytest.importorskip(
    "tests.support.robot_logs", reason="rosbags is not installed: pip install rosbags"
)
PAGE = ROOT / "docs" / "own_loop.md"


class Node:
    """Stand-in for rclpy.node.Node."""

    def __init__(self, name: str) -> None:
        self.name, self.published, self.subscriptions = name, [], {}

    def create_publisher(self, kind: type, topic: str, depth: int) -> SimpleNamespace:
        return SimpleNamespace(
            publish=lambda message: self.published.append((topic, message))
        )

    def create_subscription(
        self, kind: type, topic: str, callback: object, depth: int
    ) -> None:
        self.subscriptions[topic] = callback


@pytest.mark.slow
def test_the_code_of_the_page_prints_what_it_says(tmp_path, monkeypatch):
    for package in ("dask", "pandas"):
        pytest.importorskip(package)
    monkeypatch.chdir(tmp_path)
    for name in ("rclpy", "sensor_msgs", "std_msgs"):
        monkeypatch.setitem(sys.modules, name, SimpleNamespace())
    kinds = logs.ROS2.types
    monkeypatch.setitem(sys.modules, "rclpy.node", SimpleNamespace(Node=Node))
    monkeypatch.setitem(
        sys.modules,
        "sensor_msgs.msg",
        SimpleNamespace(Image=kinds["sensor_msgs/msg/Image"]),
    )
    monkeypatch.setitem(
        sys.modules,
        "std_msgs.msg",
        SimpleNamespace(Float64=kinds["std_msgs/msg/Float64"]),
    )

    times_s = np.arange(15) / FPS
    write_clip(tmp_path / "drive.mp4", map(BENDS.frame, times_s))
    save_camera(SMALL, tmp_path / "camera.yaml")
    (tmp_path / "drives").mkdir()
    (tmp_path / "drives" / "monday.mp4").write_bytes(
        (tmp_path / "drive.mp4").read_bytes()
    )
    images = list(read_video(tmp_path / "drive.mp4"))
    logs.write_log(tmp_path / "drives" / "monday.mcap", images, times_s)
    stamps = logs.stamps_at(times_s)
    messages = [
        logs.make_image(image, stamp, "bgr8")
        for image, stamp in zip(images, stamps, strict=True)
    ]

    code = "\n\n".join(
        re.findall(r"```python\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL)
    )
    names = {"messages": messages, "__name__": "__main__"}
    page = doctest.DocTestParser().get_doctest(code, names, PAGE.name, str(PAGE), 0)
    report: list[str] = []
    runner = doctest.DocTestRunner(optionflags=doctest.NORMALIZE_WHITESPACE)
    result = runner.run(page, out=report.append, clear_globs=False)
    assert result.attempted >= 25, "".join(report)
    assert not result.failed, "".join(report)
    node = page.globs["node"]
    assert node.subscriptions["camera/image_raw"] == node.on_image
    assert len(node.published) >= 12
    assert node.published[-1][0] == "lane/offset_m"
    assert node.published[-1][1].data == pytest.approx(
        BENDS.truth(times_s[-1]).offset_m, abs=0.1
    )
