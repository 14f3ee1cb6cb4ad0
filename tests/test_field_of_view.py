"""The field of view of an uncalibrated camera: from EXIF or assumed."""

from __future__ import annotations

from pathlib import Path

import pytest
from PIL import Image

from lanes.field_of_view import FieldOfView, find_field_of_view, given_field_of_view
from lanes.images import read_image

ENTRIES = {"focal_mm": 0x920A, "focal_35mm": 0xA405}


def photo(path: Path, size: tuple[int, int] = (640, 360), orientation: int = 1, **entries: object) -> Path:
    """A JPEG with these entries of the camera's settings."""
    exif = Image.Exif()
    exif[0x0112] = orientation
    exif.get_ifd(0x8769).update({ENTRIES[name]: value for name, value in entries.items()})
    Image.new("RGB", size, (90, 90, 90)).save(path, exif=exif)
    return path


@pytest.mark.parametrize(
    ("size", "entries", "hfov_deg"),
    [
        # 36 x 24 mm itself: the horizontal angle of a 50 mm lens
        ((720, 480), {"focal_35mm": 50}, 39.6),
        # the diagonal counts: 28 mm at 16:9 sees more to the sides than at 3:2, at 4:3 less
        ((640, 360), {"focal_35mm": 28}, 67.9),
        ((640, 480), {"focal_35mm": 28}, 63.5),
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
