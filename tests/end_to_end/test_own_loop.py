"""The code of docs/own_loop.md runs and prints what the page says, with stand-ins for
ROS.
"""

from __future__ import annotations

import doctest
import re
import shutil
import sys
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

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
TIMES_S = np.arange(15) / FPS


class Node:
    """Stand-in for rclpy.node.Node."""

    def __init__(self, name: str) -> None:
        self.name = name
        self.published: list[tuple[str, Any]] = []
        self.subscriptions: dict[str, Callable] = {}

    def create_publisher(self, kind: type, topic: str, depth: int) -> SimpleNamespace:
        def publish(message: object) -> None:
            self.published.append((topic, message))

        return SimpleNamespace(publish=publish)

    def create_subscription(
        self, kind: type, topic: str, callback: Callable, depth: int
    ) -> None:
        self.subscriptions[topic] = callback


def write_inputs(folder: Path) -> list[Any]:
    """The files that the page reads, and the messages of its log."""
    write_clip(folder / "drive.mp4", map(BENDS.frame, TIMES_S))
    save_camera(SMALL, folder / "camera.yaml")
    drives = folder / "drives"
    drives.mkdir()
    shutil.copy(folder / "drive.mp4", drives / "monday.mp4")
    images = list(read_video(folder / "drive.mp4"))
    logs.write_log(drives / "monday.mcap", images, TIMES_S)
    messages = []
    for image, stamp in zip(images, logs.stamps_at(TIMES_S), strict=True):
        messages.append(logs.make_image(image, stamp, "bgr8"))
    return messages


def stand_ins() -> dict[str, SimpleNamespace]:
    """Those of the modules of ROS, by name."""
    kinds = logs.ROS2.types
    modules = {name: SimpleNamespace() for name in ("rclpy", "sensor_msgs", "std_msgs")}
    modules["rclpy.node"] = SimpleNamespace(Node=Node)
    image = kinds["sensor_msgs/msg/Image"]
    number = kinds["std_msgs/msg/Float64"]
    modules["sensor_msgs.msg"] = SimpleNamespace(Image=image)
    modules["std_msgs.msg"] = SimpleNamespace(Float64=number)
    return modules


@pytest.fixture(scope="module")
def page(tmp_path_factory) -> doctest.DocTest:
    """The page after its code has run; what it printed is what it says."""
    for package in ("dask", "pandas"):
        pytest.importorskip(package)
    folder = tmp_path_factory.mktemp("loop")
    names = {"messages": write_inputs(folder), "__name__": "__main__"}
    blocks = re.findall(
        r"```python\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL
    )
    code = "\n\n".join(blocks)
    page = doctest.DocTestParser().get_doctest(code, names, PAGE.name, str(PAGE), 0)

    report: list[str] = []
    runner = doctest.DocTestRunner(optionflags=doctest.NORMALIZE_WHITESPACE)
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        for name, module in stand_ins().items():
            patch.setitem(sys.modules, name, module)
        result = runner.run(page, out=report.append, clear_globs=False)
    assert result.attempted >= 25
    assert not result.failed, "".join(report)
    return page


@pytest.mark.slow
def test_the_code_of_the_page_prints_what_it_says(page):
    assert page.globs["node"].name == "lanes"


@pytest.mark.slow
def test_the_node_of_the_page_subscribes_to_images(page):
    node = page.globs["node"]
    assert node.subscriptions["camera/image_raw"] == node.on_image


@pytest.mark.slow
def test_the_node_of_the_page_publishes_the_offset(page):
    """The first frames may have no lane yet."""
    published = page.globs["node"].published
    assert len(published) >= 12
    topic, message = published[-1]
    assert topic == "lane/offset_m"
    offset_m = BENDS.truth(TIMES_S[-1]).offset_m
    assert message.data == pytest.approx(offset_m, abs=0.1)
