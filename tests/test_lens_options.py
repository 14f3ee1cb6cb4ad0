"""What the commands know about lens and place of the camera: wide views, cropped photos, offsets, heights."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from lanes.camera import Camera, CameraPose, load_camera, save_camera
from lanes.drive import annotate
from lanes.files import read_telemetry
from lanes.images import write_image
from tests.support.clips import write_clip, write_drive
from tests.support.painted_drive import BENDS, SMALL, PaintedDrive

POSE = CameraPose(1.3, pitch_rad=0.06)
FRAMES = 20


def curvature_ratio(drive: PaintedDrive, folder: Path) -> float:
    """Median of the measured by the true curvature; `folder` has drive.csv."""
    table = read_telemetry(folder / "drive.csv")
    true = np.array([drive.truth(time_s).curvature_per_m for time_s in table["time_s"]])
    assert (table["confidence"][5:] > 0.5).all()
    return float(np.median(table["curvature_per_m"][5:] / true[5:]))


@pytest.mark.slow
def test_a_wide_view_is_that_of_an_action_camera_and_says_so(tmp_path, run):
    drive = replace(BENDS, camera=Camera.from_fov((960, 540), 110, POSE, lens="equidistant"))
    write_drive(tmp_path / "drive.mp4", drive, 12)
    common = "annotate", "--hfov", 110, "--height", 1.3, "--no-report", tmp_path / "drive.mp4", "-o"
    status, out, err = run(*common, tmp_path / "out")
    assert status == 0 and "warning: field of view 110.0 deg, as given, equidistant lens" in err
    assert all(words in err for words in ("times stronger; if straight edges", "give --lens pinhole", "--boards"))
    assert "which was not calibrated" in out
    assert curvature_ratio(drive, tmp_path / "out") == pytest.approx(1, abs=0.25)
    status, out, err = run(*common, tmp_path / "pinhole", "--lens", "pinhole")  # what it was taken as without a word
    assert status == 0 and not err and curvature_ratio(drive, tmp_path / "pinhole") > 1.6


def photo(path: Path, size: tuple[int, int], taken: tuple[int, int], focal_35mm: int = 28) -> Path:
    """A still of a road whose EXIF entries are those of an image of `taken` pixels."""
    exif = Image.Exif()
    exif.get_ifd(0x8769).update({0xA405: focal_35mm, 0xA002: taken[0], 0xA003: taken[1]})
    Image.fromarray(BENDS.frame(0)).resize(size).save(path, exif=exif)
    return path


def test_a_photo_cut_out_of_a_larger_one_has_its_focal_length(tmp_path, run):
    """Half of the width: the focal length in pixels is that of the whole photo."""
    path = photo(tmp_path / "cut.jpg", (600, 800), (1200, 800))
    status, _, err = run("pose", path, "-o", tmp_path / "camera.yaml")
    focal_px = 28 * np.hypot(1200, 800) / np.hypot(36, 24)
    assert status == 0 and "as cut.jpg says (EXIF)" in err
    assert load_camera(tmp_path / "camera.yaml").matrix[0, 0] == pytest.approx(focal_px, rel=1e-3)


@pytest.mark.parametrize(
    ("taken", "focal_35mm", "named"),
    [
        # 13 mm: of a phone without distortion, of an action camera with it
        ((640, 360), 13, "110.8 deg, as part.jpg says (EXIF), pinhole lens. The angle does not say how the lens maps"),
        (
            (2000, 1500),
            28,
            "60.0 deg, assumed, because part.jpg has 640x360 pixels, but its EXIF entries are those of 2000x1500: it "
            "was cropped",
        ),
    ],
)
def test_a_photo_whose_entries_do_not_determine_the_lens_says_so(tmp_path, run, taken, focal_35mm, named):
    status, _, err = run(
        "annotate", photo(tmp_path / "part.jpg", (640, 360), taken, focal_35mm), "-o", tmp_path / "out"
    )
    assert status == 0 and f"warning: field of view {named}" in err
    assert ("give --hfov and --lens equidistant" in err) == (focal_35mm == 13)


@pytest.mark.parametrize("calibrated", [True, False])
def test_whether_a_lens_was_calibrated_does_not_depend_on_its_distortion(tmp_path, run, calibrated):
    write_clip(tmp_path / "drive.mp4", map(BENDS.frame, np.arange(6) / 25))
    camera = Camera(640, 360, SMALL.matrix, np.zeros(5)) if calibrated else Camera.from_fov((640, 360), 58)
    save_camera(camera, tmp_path / "lens.yaml")
    options = "--pictures", 3, "--camera", tmp_path / "lens.yaml", tmp_path / "drive.mp4"
    status, out, _ = run("pose", *options, "-o", tmp_path / "camera.yaml")
    assert status == 0 and ("which was not calibrated" in out) == (not calibrated)
    assert load_camera(tmp_path / "camera.yaml").calibrated == calibrated


@pytest.fixture(scope="module")
def lorry(tmp_path_factory) -> Path:
    """A drive whose camera is 0.7 m right of the middle of the car, which is 0.3 m left of the lane centre."""
    folder = tmp_path_factory.mktemp("lorry")
    drive = replace(BENDS, motion=replace(BENDS.motion, offset_m=0.3 - 0.7))
    write_drive(folder / "drive.mp4", drive, FRAMES)
    return folder


def test_the_offset_is_that_of_the_car(lorry, tmp_path, run):
    common = "annotate", "--camera", lorry / "drive.yaml", "--no-report", lorry / "drive.mp4", "-o"
    assert run(*common, tmp_path / "beside")[0] == 0
    assert run(*common, tmp_path / "middle", "--camera-offset", -0.7)[0] == 0
    beside, middle = (read_telemetry(tmp_path / name / "drive.csv") for name in ("beside", "middle"))
    truth = read_telemetry(lorry / "drive.csv")
    assert np.median(beside["offset_m"] - truth["offset_m"]) == pytest.approx(0, abs=0.05)
    assert middle["offset_m"] == pytest.approx(beside["offset_m"] + 0.7, abs=1e-6, nan_ok=True)
    # the lines stay where the camera sees them
    assert middle["left_c0_m"] == pytest.approx(beside["left_c0_m"], abs=1e-6, nan_ok=True)


def test_the_warnings_are_those_of_the_car(tmp_path):
    """The camera is so near to the line that tyres would be on it; the car is in the middle of its lane.

    A car that keeps its place crosses no line.
    """
    drive = replace(BENDS, motion=replace(BENDS.motion, offset_m=-1.0))
    write_drive(tmp_path / "drive.mp4", drive, 2 * FRAMES)
    warnings, said = [], []
    for offset_m in (None, -1.0):
        options = {"progress": False, "report": False, "camera_offset_m": offset_m}
        (result,) = annotate(tmp_path / "drive.mp4", tmp_path / str(offset_m), drive.camera, **options)
        warnings.append(np.isin(result.telemetry["departure"], ("left", "right")).sum())
        said.append("give --camera-offset or --car-width" in result.description)
    assert warnings == [0, 0] and said == [True, False]


def test_the_offset_is_kept_in_the_camera_file(lorry, tmp_path, run):
    path = tmp_path / "camera.yaml"
    options = "--camera", lorry / "drive.yaml", "--camera-offset", -0.7, "--pictures", 3
    status, out, _ = run("pose", *options, "--car-width", 2.1, lorry / "drive.mp4", "-o", path)
    assert status == 0 and "of 3 used" in out
    assert load_camera(path).offset_m == -0.7 and load_camera(path).pose is not None
    assert load_camera(path).car_width_m == 2.1
    assert run("annotate", "--camera", path, "--no-report", lorry / "drive.mp4", "-o", tmp_path / "out")[0] == 0
    table, truth = read_telemetry(tmp_path / "out" / "drive.csv"), read_telemetry(lorry / "drive.csv")
    assert np.median(table["offset_m"] - truth["offset_m"]) == pytest.approx(0.7, abs=0.1)
    status, _, err = run("annotate", "--camera-offset", 65, lorry / "drive.mp4", "-o", tmp_path / "out")
    assert status == 2 and "-2 to 2" in err


@pytest.mark.slow
def test_height_and_lane_width_determine_the_scale(lorry, tmp_path, run):
    """All lengths are proportional to a measured height; a given width is the width."""
    still = write_image(tmp_path / "still.png", BENDS.frame(0))
    lens = tmp_path / "lens.yaml"
    save_camera(replace(SMALL, pose=None), lens)
    common = "annotate", "--camera", lens, "--no-report", "--end", 0.2, "-o", tmp_path / "out"

    def width_m(source: Path, *option: object) -> float:
        assert run(*common, *option, source)[0] == 0
        table = tmp_path / "out" / ("pictures.csv" if source == still else "drive.csv")
        return float(np.nanmedian(read_telemetry(table)["lane_width_m"]))

    low_m, high_m = (width_m(lorry / "drive.mp4", "--height", height_m) for height_m in (1.1, 1.3))
    assert high_m / low_m == pytest.approx(1.3 / 1.1, abs=0.05) and high_m == pytest.approx(3.6, abs=0.2)
    assert width_m(still, "--height", 1.3) == pytest.approx(3.6, abs=0.2)
    assert width_m(still, "--lane-width", 3.2) == pytest.approx(3.2, abs=0.12)
    status, _, err = run("detect", "--camera", lorry / "drive.yaml", "--height", 1.3, still, "-o", tmp_path / "x.jsonl")
    assert status == 2 and "the camera file holds a pose; omit --height" in err
