"""What is known about lens and place of the camera: fields of view, cropped photos,
offsets, heights.
"""

from __future__ import annotations

import warnings
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import ExifTags, Image

from lanes.camera.field_of_view import (
    FieldOfView,
    find_field_of_view,
    given_field_of_view,
)
from lanes.camera.model import Camera, CameraPose, load_camera, save_camera
from lanes.drive import annotate
from lanes.files import read_telemetry
from lanes.video.images import read_image, write_image
from tests.support.clips import write_clip, write_drive
from tests.support.command_line import run as run_alone
from tests.support.painted_drive import BENDS, SMALL, PaintedDrive

POSE = CameraPose(1.3, pitch_rad=0.06)
FRAMES = 20
ASSUMED = FieldOfView(60.0, "", assumed=True)

# A wide view.

WIDE = replace(BENDS, camera=Camera.from_fov((960, 540), 110, POSE, lens="equidistant"))


def curvature_ratio(drive: PaintedDrive, folder: Path) -> float:
    """Median of the measured by the true curvature; `folder` has drive.csv."""
    table = read_telemetry(folder / "drive.csv")
    true = [drive.truth(time_s).curvature_per_m for time_s in table["time_s"]]
    assert (table["confidence"][5:] > 0.5).all()
    ratio = table["curvature_per_m"] / np.array(true)
    return float(np.median(ratio[5:]))


def annotate_wide(folder: Path, *options: object) -> tuple[str, str]:
    """What the command prints, and what it warns of."""
    write_drive(folder / "drive.mp4", WIDE, 12)
    status, out, err = run_alone(
        "annotate",
        folder / "drive.mp4",
        "--hfov",
        110,
        "--height",
        1.3,
        "--no-report",
        "-o",
        folder / "out",
        *options,
    )
    assert status == 0
    return out, err


@pytest.mark.slow
def test_a_wide_view_is_that_of_an_action_camera_and_says_so(tmp_path):
    out, err = annotate_wide(tmp_path)

    assert curvature_ratio(WIDE, tmp_path / "out") == pytest.approx(1, abs=0.25)
    assert "warning: field of view 110.0 deg, as given, equidistant lens" in err
    assert "2.2 times stronger; if straight edges" in err
    assert "give --lens pinhole" in err
    assert "--boards" in err
    assert "which was not calibrated" in out


@pytest.mark.slow
def test_a_wide_view_is_that_of_a_pinhole_camera_if_the_user_says_so(tmp_path):
    _, err = annotate_wide(tmp_path, "--lens", "pinhole")

    assert not err
    assert curvature_ratio(WIDE, tmp_path / "out") > 1.6


# EXIF entries.


def photo(
    path: Path,
    size: tuple[int, int] = (640, 360),
    *,
    taken: tuple[int, int] | None = None,
    orientation: int = 1,
    focal_35mm: int | None = None,
    focal_mm: float | None = None,
) -> Path:
    """A still of a road whose EXIF entries are these; the size that is `taken` is that
    before it was cut.
    """
    exif = Image.Exif()
    exif[ExifTags.Base.Orientation] = orientation
    entries = exif.get_ifd(ExifTags.IFD.Exif)
    if focal_35mm is not None:
        entries[ExifTags.Base.FocalLengthIn35mmFilm.value] = focal_35mm
    if focal_mm is not None:
        entries[ExifTags.Base.FocalLength.value] = focal_mm
    if taken:
        width, height = taken
        entries[ExifTags.Base.ExifImageWidth.value] = width
        entries[ExifTags.Base.ExifImageHeight.value] = height
    Image.fromarray(BENDS.frame(0)).resize(size).save(path, exif=exif)
    return path


@pytest.mark.parametrize("focal_35mm", [0, 65535])
def test_a_focal_length_that_is_unknown_is_as_none(tmp_path, focal_35mm):
    still = photo(tmp_path / "still.jpg", focal_35mm=focal_35mm)
    with warnings.catch_warnings(action="error"):
        assert find_field_of_view([still]) == ASSUMED


@pytest.mark.parametrize(
    ("size", "focal_35mm", "taken", "hfov_deg"),
    [
        pytest.param((720, 480), 50, None, 39.6, id="36 x 24 mm itself"),
        # the diagonal counts: 28 mm at 16:9 sees more to the sides than at 3:2, at 4:3
        # less
        pytest.param((640, 360), 28, None, 67.9, id="16:9"),
        pytest.param((640, 480), 28, None, 63.5, id="4:3"),
        pytest.param((640, 360), 28, (360, 640), 67.9, id="turned by a program"),
    ],
)
def test_the_focal_length_becomes_an_angle(tmp_path, size, focal_35mm, taken, hfov_deg):
    path = photo(tmp_path / "a.jpg", size, focal_35mm=focal_35mm, taken=taken)

    found = find_field_of_view([path])

    assert found.hfov_deg == pytest.approx(hfov_deg, abs=0.1)
    assert not found.assumed
    assert "as a.jpg says (EXIF)" in found.describe()
    assert "1.5 times too strong" not in found.describe()


@pytest.mark.parametrize(
    "entries", [{}, {"focal_mm": 4.2}, {"focal_35mm": 0}, {"focal_35mm": 4000}]
)
def test_without_a_usable_focal_length_the_angle_is_assumed(tmp_path, entries):
    found = find_field_of_view([photo(tmp_path / "a.jpg", **entries)])

    assert found.hfov_deg == pytest.approx(60.0, abs=0.1)
    assert found.assumed
    assert "assumed" in found.describe()
    assert "1.5 times too strong" in found.describe()


@pytest.mark.parametrize("orientation", range(1, 9))
def test_a_phone_that_is_held_upright_sees_less_to_the_sides(tmp_path, orientation):
    """26 mm is 71.9 degrees lying, 44.4 degrees standing."""
    path = photo(tmp_path / "a.jpg", orientation=orientation, focal_35mm=26)
    is_lying = orientation <= 4
    assert (read_image(path).shape[1] == 640) == is_lying

    found = find_field_of_view([path])

    assert found.hfov_deg == pytest.approx(71.9 if is_lying else 44.4, abs=0.1)


def test_the_first_still_with_the_entries_is_used(tmp_path):
    without = photo(tmp_path / "a.jpg")
    with_entries = photo(tmp_path / "b.jpg", focal_35mm=28)

    found = find_field_of_view([without, tmp_path / "drive.mp4", with_entries])

    assert found.describe() == "field of view 67.9 deg, as b.jpg says (EXIF)"


def test_a_photo_cut_out_of_a_larger_one_has_its_focal_length(tmp_path, run):
    """Half of the width: the focal length in pixels is that of the whole photo."""
    path = photo(tmp_path / "cut.jpg", (600, 800), taken=(1200, 800), focal_35mm=28)
    focal_px = 28 * np.hypot(1200, 800) / np.hypot(36, 24)

    status, _, err = run("pose", path, "-o", tmp_path / "camera.yaml")

    assert status == 0
    assert "as cut.jpg says (EXIF)" in err
    camera = load_camera(tmp_path / "camera.yaml")
    assert camera.matrix[0, 0] == pytest.approx(focal_px, rel=1e-3)


def test_a_wide_photo_says_that_its_lens_is_not_known(tmp_path, run):
    """13 mm: of a phone without distortion, of an action camera with it."""
    path = photo(tmp_path / "part.jpg", taken=(640, 360), focal_35mm=13)

    status, _, err = run("annotate", path, "-o", tmp_path / "out")

    assert status == 0
    assert (
        "warning: field of view 110.8 deg, as part.jpg says (EXIF), pinhole lens. "
        "The angle does not say how the lens maps"
    ) in err
    assert "give --hfov and --lens equidistant" in err


def test_a_photo_that_was_resized_says_that_its_angle_is_not_known(tmp_path, run):
    path = photo(tmp_path / "part.jpg", taken=(2000, 1500), focal_35mm=28)

    status, _, err = run("annotate", path, "-o", tmp_path / "out")

    assert status == 0
    assert (
        "warning: field of view 60.0 deg, assumed, because part.jpg has 640x360 "
        "pixels, but its EXIF entries are those of 2000x1500: it was cropped"
    ) in err
    assert "give --hfov and --lens equidistant" not in err


# Portrait images.


@pytest.mark.parametrize(
    ("size", "hfov_deg"), [((1280, 720), 60.0), ((720, 720), 60.0), ((720, 1280), 36.0)]
)
def test_an_assumed_field_of_view_is_that_of_the_longer_side(size, hfov_deg):
    assert ASSUMED.across(size) == pytest.approx(hfov_deg, abs=0.05)


@pytest.mark.parametrize("size", [(1280, 720), (720, 720), (720, 1280)])
def test_a_given_field_of_view_is_that_of_the_width(size):
    assert FieldOfView(50.0, "as given").across(size) == 50.0


@pytest.mark.parametrize(
    ("size", "words"),
    [
        ((480, 768), "--hfov 60 across their narrow side is 85 deg"),
        ((480, 768), "give --hfov 40"),
        ((720, 1280), "91 deg across the longer one"),
        ((720, 1280), "give --hfov 36"),
        ((720, 1280), "omit --hfov"),
    ],
)
def test_a_given_angle_that_is_hardly_that_of_the_narrow_side_is_doubted(size, words):
    assert words in given_field_of_view(60).doubt_about(size)


@pytest.mark.parametrize(
    ("field", "size"),
    [
        pytest.param(given_field_of_view(60), (1280, 720), id="landscape"),
        pytest.param(given_field_of_view(40), (480, 768), id="narrow"),
        pytest.param(
            given_field_of_view(60, "equidistant"), (480, 768), id="lens given"
        ),
        pytest.param(ASSUMED, (480, 768), id="assumed"),
        pytest.param(ASSUMED, (720, 1280), id="assumed, 16:9"),
    ],
)
def test_other_angles_are_not_doubted(field, size):
    assert not field.doubt_about(size)


def test_commands_warn_of_an_angle_that_is_hardly_that_of_a_portrait_image(
    tmp_path, run
):
    """Measured with --hfov 60 on a portrait clip: 24 % of the lanes are likely, 82 %
    without.
    """
    path = tmp_path / "a.png"
    Image.new("RGB", (90, 160), (90, 90, 90)).save(path)

    status, _, err = run("detect", "--hfov", 60, path, "-o", tmp_path / "lanes.jsonl")

    assert status == 0
    assert err.count("warning") == 1
    assert f"warning: {path}: the images are in" in err


# Camera files.

CALIBRATED = Camera(640, 360, SMALL.matrix, np.zeros(5))


@pytest.mark.parametrize("camera", [CALIBRATED, Camera.from_fov((640, 360), 58)])
def test_whether_a_lens_was_calibrated_does_not_depend_on_its_distortion(
    tmp_path, run, camera
):
    write_clip(tmp_path / "drive.mp4", map(BENDS.frame, np.arange(6) / 25))
    lens = save_camera(camera, tmp_path / "lens.yaml")

    status, out, _ = run(
        "pose",
        tmp_path / "drive.mp4",
        "--pictures",
        3,
        "--camera",
        lens,
        "-o",
        tmp_path / "camera.yaml",
    )

    assert status == 0
    assert ("which was not calibrated" in out) == (not camera.calibrated)
    found = load_camera(tmp_path / "camera.yaml")
    assert found.calibrated == camera.calibrated


# The place in the car.

BESIDE_M = -0.7


@pytest.fixture(scope="module")
def lorry(tmp_path_factory) -> Path:
    """A drive whose camera is 0.7 m right of the middle of the car, which is 0.3 m left
    of the lane centre.
    """
    folder = tmp_path_factory.mktemp("lorry")
    motion = replace(BENDS.motion, offset_m=0.3 + BESIDE_M)
    return write_drive(folder / "drive.mp4", replace(BENDS, motion=motion), FRAMES)


@pytest.fixture(scope="module")
def placed(lorry) -> Path:
    """The camera file of that drive, with pose, offset and width of the car."""
    path = lorry.with_name("placed.yaml")
    status, out, err = run_alone(
        "pose",
        lorry,
        "--camera",
        lorry.with_suffix(".yaml"),
        "--camera-offset",
        BESIDE_M,
        "--pictures",
        3,
        "--car-width",
        2.1,
        "-o",
        path,
    )
    assert status == 0, err
    assert "of 3 used" in out
    return path


@pytest.fixture
def measure(lorry, tmp_path, run):
    """A function that gives the telemetry of that drive with options."""

    def measure(*options: object) -> dict[str, np.ndarray]:
        status, _, _ = run("annotate", "--no-report", *options, lorry, "-o", tmp_path)
        assert status == 0
        return read_telemetry(tmp_path / "drive.csv")

    return measure


class TestTheOffsetOfTheCamera:
    def test_stays_in_the_camera_file_with_the_width_of_the_car(self, placed):
        camera = load_camera(placed)
        assert (camera.offset_m, camera.car_width_m) == (BESIDE_M, 2.1)
        assert camera.pose is not None

    def test_is_none_if_none_is_given(self, lorry, measure):
        true_m = read_telemetry(lorry.with_suffix(".csv"))["offset_m"]

        measured_m = measure("--camera", lorry.with_suffix(".yaml"))["offset_m"]

        assert np.median(measured_m - true_m) == pytest.approx(0, abs=0.05)

    @pytest.mark.parametrize(
        ("column", "shift_m"),
        [
            ("offset_m", -BESIDE_M),
            # the lines stay where the camera sees them
            ("left_c0_m", 0.0),
        ],
    )
    def test_shifts_the_car_and_not_the_lines(self, lorry, measure, column, shift_m):
        lens = lorry.with_suffix(".yaml")
        beside_m = measure("--camera", lens)[column]

        middle = measure("--camera", lens, "--camera-offset", BESIDE_M)

        expected_m = pytest.approx(beside_m + shift_m, abs=1e-6, nan_ok=True)
        assert middle[column] == expected_m

    def test_is_read_from_the_camera_file(self, lorry, placed, measure):
        true_m = read_telemetry(lorry.with_suffix(".csv"))["offset_m"]

        measured_m = measure("--camera", placed)["offset_m"]

        assert np.median(measured_m - true_m) == pytest.approx(-BESIDE_M, abs=0.1)


@pytest.mark.parametrize(("camera_offset_m", "advised"), [(None, True), (-1.0, False)])
def test_the_warnings_are_those_of_the_car(tmp_path, camera_offset_m, advised):
    """The camera is so near to the line that tyres would be on it; the car is in the
    middle of its lane.

    A car that keeps its place crosses no line.
    """
    drive = replace(BENDS, motion=replace(BENDS.motion, offset_m=-1.0))
    write_drive(tmp_path / "drive.mp4", drive, 2 * FRAMES)

    (result,) = annotate(
        tmp_path / "drive.mp4",
        tmp_path / "out",
        drive.camera,
        progress=False,
        report=False,
        camera_offset_m=camera_offset_m,
    )

    assert not np.isin(result.telemetry["departure"], ("left", "right")).any()
    advice = "give --camera-offset (> 0: left as the camera looks) or --car-width"
    assert (advice in result.description) == advised


@pytest.mark.slow
class TestTheScale:
    """All lengths are proportional to a measured height; a given width is the width."""

    @pytest.fixture
    def width_m(self, tmp_path, run):
        """A function that gives the median lane width of a source with options."""
        lens = save_camera(replace(SMALL, pose=None), tmp_path / "lens.yaml")

        def width_m(source: Path, *options: object) -> float:
            status, _, _ = run(
                "annotate",
                source,
                "--camera",
                lens,
                "--no-report",
                "--end",
                0.2,
                *options,
                "-o",
                tmp_path / "out",
            )
            assert status == 0
            (table,) = (tmp_path / "out").glob("*.csv")
            return float(np.nanmedian(read_telemetry(table)["lane_width_m"]))

        return width_m

    def test_is_proportional_to_the_height(self, lorry, width_m):
        low_m = width_m(lorry, "--height", 1.1)
        high_m = width_m(lorry, "--height", 1.3)
        assert high_m == pytest.approx(3.6, abs=0.2)
        assert high_m / low_m == pytest.approx(1.3 / 1.1, abs=0.05)

    @pytest.mark.parametrize(
        ("options", "expected_m", "abs_m"),
        [(("--height", 1.3), 3.6, 0.2), (("--lane-width", 3.2), 3.2, 0.12)],
    )
    def test_height_and_lane_width_determine_the_scale(
        self, tmp_path, width_m, options, expected_m, abs_m
    ):
        still = write_image(tmp_path / "still.png", BENDS.frame(0))
        assert width_m(still, *options) == pytest.approx(expected_m, abs=abs_m)
