"""Dash period and field of view from painted drives with a known period."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from lanes.dash_period import field_of_view_from_dashes, measure_dash_period
from lanes.images import write_image
from lanes.video.writer import VideoWriter
from simulator.rendering.drive import Motion
from tests.support.painted_drive import CAMERA, PaintedDrive, lane_lines, s_bend


def drive_pictures(count: int = 8, lines=None) -> list[np.ndarray]:
    """Bends both ways, weaving and bumps; the broken lines are painted every 12.2 m."""
    motion = Motion(speed_mps=23.0, offset_m=0.2, wander_m=0.2, pitch_rad=np.radians(0.3))
    drive = PaintedDrive(s_bend(), lines or lane_lines(), motion)
    return [drive.frame(1.22 * n) for n in range(count)]


@pytest.mark.parametrize("stretch", [0.75, 1.0, 1.4])
def test_the_period_grows_with_the_focal_length(stretch):
    """All distances are proportional to the focal length, and the angles of the pose are inversely so."""
    matrix = CAMERA.matrix.copy()
    matrix[[0, 1], [0, 1]] *= stretch
    pose = replace(CAMERA.pose, pitch_rad=CAMERA.pose.pitch_rad / stretch, yaw_rad=CAMERA.pose.yaw_rad / stretch)
    camera = replace(CAMERA, matrix=matrix, distortion=CAMERA.distortion / stretch**2, pose=pose)
    period = measure_dash_period(drive_pictures(), camera)
    assert period.period_m == pytest.approx(12.2 * stretch, rel=0.03)
    assert period.clarity > 25


def test_solid_lines_have_no_period():
    lines = lane_lines(right={"dash_m": None})[:2]
    assert measure_dash_period(drive_pictures(lines=lines), CAMERA) is None


def test_pictures_become_a_field_of_view(tmp_path):
    files = [write_image(tmp_path / f"{n}.png", image) for n, image in enumerate(drive_pictures())]
    found = field_of_view_from_dashes(files, 12.2)
    # the true lens has 58.2 degrees and distortion, which is not modelled here
    assert found.hfov_deg == pytest.approx(58.2, abs=3)
    assert "broken lines of 12.2 m" in found.source


def test_only_the_given_part_of_a_video_is_used(tmp_path):
    pictures = drive_pictures()
    with VideoWriter(tmp_path / "drive.mp4", fps=1) as video:
        for image in [*np.full((4, *pictures[0].shape), 128, np.uint8), *pictures]:
            video.write(image)
    found = field_of_view_from_dashes([tmp_path / "drive.mp4"], 12.2, start_s=4.0)
    assert found.hfov_deg == pytest.approx(58.2, abs=4)
    with pytest.raises(ValueError, match="no broken line"):
        field_of_view_from_dashes([tmp_path / "drive.mp4"], 12.2, end_s=4.0)


def test_no_broken_lines(tmp_path):
    wall = write_image(tmp_path / "wall.png", np.full((360, 640, 3), 128, np.uint8))
    with pytest.raises(ValueError, match=r"wall\.png: shows no broken line with a clear period"):
        field_of_view_from_dashes([wall], 12.2)
    with pytest.raises(ValueError, match="live camera"):
        field_of_view_from_dashes([], 12.2)
