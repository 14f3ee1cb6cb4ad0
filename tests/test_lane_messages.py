"""Messages of a robot log: spooled beside the output, not in the system's temporary folder."""

from __future__ import annotations

import tempfile

import numpy as np
import pytest

from lanes.camera import save_camera
from lanes.drive import DriveSettings, annotate_drive
from tests.support.command_line import main
from tests.support.painted_drive import BENDS, SMALL
from tests.support.project import names

logs = pytest.importorskip("tests.support.robot_logs", reason="rosbags is not installed: pip install rosbags")


def test_messages_need_no_space_in_the_temporary_folder(tmp_path, monkeypatch):
    """It may be in memory. What a killed run has left is replaced, and nothing else stays."""
    out = tmp_path / "out"
    log = logs.write_log(tmp_path / "drive.mcap", [BENDS.frame(n / 25) for n in range(4)], np.arange(4) / 25)
    save_camera(SMALL, tmp_path / "camera.yaml")
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "nothing"))
    (out / "drive.lane.partial.spool" / "lane").mkdir(parents=True)
    (out / "drive.lane.partial.spool" / "lane" / "lane.mcap").write_bytes(b"half")
    assert main(["annotate", "--camera", str(tmp_path / "camera.yaml"), str(log), "-o", str(out)]) == 0
    assert names(out) == {"drive.mp4", "drive.csv", "drive.html", "drive.lane.mcap"}

    def fail(*_: object) -> None:
        raise OSError("no space")

    monkeypatch.setattr("lanes.lane_messages.LaneMessageWriter.write", fail)
    with pytest.raises(OSError, match="no space"):
        annotate_drive(log, DriveSettings(output=tmp_path / "failed", camera=SMALL, progress=False))
    assert names(tmp_path / "failed") == set()
