"""What is known about lens and place of the camera: fields of view, cropped photos, offsets, heights."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import ExifTags, Image

from lanes.camera.field_of_view import FieldOfView, find_field_of_view, given_field_of_view
from lanes.camera.model import Camera, CameraPose, load_camera, save_camera
from lanes.drive import annotate
from lanes.files import read_telemetry
from lanes.video.images import read_image, write_image
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
    assert all(words in err for words in ("2.2 times stronger; if straight edges", "give --lens pinhole", "--boards"))
    assert "which was not calibrated" in out
    assert curvature_ratio(drive, tmp_path / "out") == pytest.approx(1, abs=0.25)
    status, out, err = run(*common, tmp_path / "pinhole", "--lens", "pinhole")  # what it was taken as without a word
    assert status == 0 and not err and curvature_ratio(drive, tmp_path / "pinhole") > 1.6


def photo(
    path: Path,
    size: tuple[int, int] = (640, 360),
    *,
    taken: tuple[int, int] | None = None,
    orientation: int = 1,
    focal_35mm: int | None = None,
    focal_mm: float | None = None,
) -> Path:
    """A still of a road whose EXIF entries are these; the size that is `taken` is that before it was cut."""
    exif = Image.Exif()
    exif[ExifTags.Base.Orientation] = orientation
    width, height = taken or (None, None)
    entries = {0xA405: focal_35mm, 0x920A: focal_mm, 0xA002: width, 0xA003: height}
    exif.get_ifd(ExifTags.IFD.Exif).update({name: value for name, value in entries.items() if value is not None})
    Image.fromarray(BENDS.frame(0)).resize(size).save(path, exif=exif)
    return path


@pytest.mark.parametrize(
    ("size", "entries", "hfov_deg"),
    [
        # 36 x 24 mm itself: the horizontal angle of a 50 mm lens
        ((720, 480), {"focal_35mm": 50}, 39.6),
        # the diagonal counts: 28 mm at 16:9 sees more to the sides than at 3:2, at 4:3 less
        ((640, 360), {"focal_35mm": 28}, 67.9),
        ((640, 480), {"focal_35mm": 28}, 63.5),
        ((640, 360), {"focal_35mm": 28, "taken": (360, 640)}, 67.9),  # turned by a program
        # assumed: 60 degrees
        *(((640, 360), entries, None) for entries in ({}, {"focal_mm": 4.2}, {"focal_35mm": 0}, {"focal_35mm": 4000})),
    ],
)
def test_the_focal_length_becomes_an_angle(tmp_path, size, entries, hfov_deg):
    found = find_field_of_view([photo(tmp_path / "a.jpg", size, **entries)])
    assert found.hfov_deg == pytest.approx(hfov_deg or 60.0, abs=0.1) and found.assumed == (hfov_deg is None)
    assert ("assumed" if found.assumed else "as a.jpg says (EXIF)") in found.describe()
    assert ("1.5 times too strong" in found.describe()) == found.assumed


@pytest.mark.parametrize("orientation", range(1, 9))
def test_a_phone_that_is_held_upright_sees_less_to_the_sides(tmp_path, orientation):
    """26 mm is 71.9 degrees lying, 44.4 degrees standing."""
    path = photo(tmp_path / "a.jpg", orientation=orientation, focal_35mm=26)
    lying = read_image(path).shape[1] == 640
    assert lying == (orientation <= 4)
    assert find_field_of_view([path]).hfov_deg == pytest.approx(71.9 if lying else 44.4, abs=0.1)


def test_the_first_still_with_the_entries_is_used(tmp_path):
    files = [photo(tmp_path / "a.jpg"), tmp_path / "drive.mp4", photo(tmp_path / "b.jpg", focal_35mm=28)]
    assert find_field_of_view(files).describe() == "field of view 67.9 deg, as b.jpg says (EXIF)"


@pytest.mark.parametrize(("size", "hfov_deg"), [((1280, 720), 60.0), ((720, 720), 60.0), ((720, 1280), 36.0)])
def test_an_assumed_field_of_view_is_that_of_the_longer_side(size, hfov_deg):
    assert FieldOfView(60.0, "", assumed=True).across(size) == pytest.approx(hfov_deg, abs=0.05)
    assert FieldOfView(50.0, "as given").across(size) == 50.0


@pytest.mark.parametrize(
    ("hfov_deg", "lens", "size", "named"),
    [
        (60, None, (480, 768), ("--hfov 60 across their narrow side is 85 deg", "give --hfov 40")),
        (60, None, (720, 1280), ("91 deg across the longer one", "give --hfov 36", "omit --hfov")),
        (60, None, (1280, 720), None),
        (40, None, (480, 768), None),
        (60, "equidistant", (480, 768), None),
    ],
)
def test_a_given_angle_that_is_hardly_that_of_the_narrow_side_is_doubted(hfov_deg, lens, size, named):
    doubt = given_field_of_view(hfov_deg, lens).doubt_about(size)
    assert all(words in doubt for words in named) if named else not doubt
    assert not FieldOfView(60.0, "", assumed=True).doubt_about(size)


def test_commands_warn_of_an_angle_that_is_hardly_that_of_a_portrait_image(tmp_path, run):
    """Measured with --hfov 60 on a portrait clip: 24 % of the lanes are likely, 82 % without."""
    Image.new("RGB", (90, 160), (90, 90, 90)).save(tmp_path / "a.png")
    status, _, err = run("detect", "--hfov", 60, tmp_path / "a.png", "-o", tmp_path / "lanes.jsonl")
    assert status == 0 and err.count("warning") == 1 and f"warning: {tmp_path / 'a.png'}: the images are in" in err


def test_a_photo_cut_out_of_a_larger_one_has_its_focal_length(tmp_path, run):
    """Half of the width: the focal length in pixels is that of the whole photo."""
    path = photo(tmp_path / "cut.jpg", (600, 800), taken=(1200, 800), focal_35mm=28)
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
    path = photo(tmp_path / "part.jpg", taken=taken, focal_35mm=focal_35mm)
    status, _, err = run("annotate", path, "-o", tmp_path / "out")
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


def test_the_offset_is_that_of_the_car_and_kept_in_the_camera_file(lorry, tmp_path, run):
    path, drive = tmp_path / "camera.yaml", lorry / "drive.mp4"
    options = "--camera", lorry / "drive.yaml", "--camera-offset", -0.7
    status, out, _ = run("pose", *options, "--pictures", 3, "--car-width", 2.1, drive, "-o", path)
    assert status == 0 and "of 3 used" in out
    camera = load_camera(path)
    assert (camera.offset_m, camera.car_width_m) == (-0.7, 2.1) and camera.pose is not None
    tables = {}
    for name, given in {"beside": options[:2], "middle": options, "kept": ("--camera", path)}.items():
        assert run("annotate", *given, "--no-report", drive, "-o", tmp_path / name)[0] == 0
        tables[name] = read_telemetry(tmp_path / name / "drive.csv")
    true_m, beside_m = (table["offset_m"] for table in (read_telemetry(lorry / "drive.csv"), tables["beside"]))
    assert np.median(beside_m - true_m) == pytest.approx(0, abs=0.05)
    assert tables["middle"]["offset_m"] == pytest.approx(beside_m + 0.7, abs=1e-6, nan_ok=True)
    # the lines stay where the camera sees them
    assert tables["middle"]["left_c0_m"] == pytest.approx(tables["beside"]["left_c0_m"], abs=1e-6, nan_ok=True)
    assert np.median(tables["kept"]["offset_m"] - true_m) == pytest.approx(0.7, abs=0.1)


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
