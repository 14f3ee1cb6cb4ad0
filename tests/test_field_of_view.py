"""The field of view of an uncalibrated camera: from EXIF or assumed."""

from __future__ import annotations

from pathlib import Path

import pytest
from PIL import Image

from lanes.field_of_view import FieldOfView, find_field_of_view, read_hfov
from lanes.images import read_image

EXIF_BLOCK = 0x8769


def photo(path: Path, size: tuple[int, int] = (640, 360), **entries: object) -> Path:
    """A JPEG with these entries of the camera's settings."""
    numbers = {"focal_mm": 0x920A, "focal_35mm": 0xA405}
    exif = Image.Exif()
    exif[0x010F] = "maker"
    exif[0x0112] = entries.pop("orientation", 1)
    exif.get_ifd(EXIF_BLOCK).update({numbers[name]: value for name, value in entries.items()})
    Image.new("RGB", size, (90, 90, 90)).save(path, exif=exif)
    return path


class TestExif:
    @pytest.mark.parametrize(
        ("size", "entries", "hfov_deg"),
        [
            # 36 x 24 mm itself: the horizontal angle of a 50 mm lens
            ((720, 480), {"focal_35mm": 50}, 39.6),
            # the diagonal counts: 28 mm at 16:9 sees more to the sides than at 3:2, at 4:3 less
            ((640, 360), {"focal_35mm": 28}, 67.9),
            ((640, 480), {"focal_35mm": 28}, 63.5),
        ],
    )
    def test_the_focal_length_becomes_an_angle(self, tmp_path, size, entries, hfov_deg):
        assert read_hfov(photo(tmp_path / "a.jpg", size, **entries)) == pytest.approx(hfov_deg, abs=0.1)

    @pytest.mark.parametrize("orientation", range(1, 9))
    def test_the_image_is_upright(self, tmp_path, orientation):
        """A phone that is held upright sees less to the sides: 26 mm is 71 degrees lying, 43.7 degrees standing."""
        path = photo(tmp_path / "a.jpg", orientation=orientation, focal_35mm=26)
        lying = read_image(path).shape[1] == 640
        assert lying == (orientation <= 4)
        assert read_hfov(path) == pytest.approx(71.9 if lying else 44.4, abs=0.1)

    @pytest.mark.parametrize("entries", [{}, {"focal_mm": 4.2}, {"focal_35mm": 0}, {"focal_35mm": 4000}])
    def test_insufficient_entries_give_none(self, tmp_path, entries):
        assert read_hfov(photo(tmp_path / "a.jpg", **entries)) is None

    def test_the_first_still_with_the_entries_is_used(self, tmp_path):
        files = [photo(tmp_path / "a.jpg"), tmp_path / "drive.mp4", photo(tmp_path / "b.jpg", focal_35mm=28)]
        found = find_field_of_view(files)
        assert found.hfov_deg == pytest.approx(67.9, abs=0.1)
        assert found.describe() == "field of view 67.9 deg, as b.jpg says (EXIF)"

    def test_without_entries_the_default_comes_with_a_warning(self, tmp_path):
        found = find_field_of_view([photo(tmp_path / "a.jpg")])
        assert (found.hfov_deg, found.assumed) == (60.0, True)
        assert "assumed" in found.describe() and "1.5 times too strong" in found.describe()


@pytest.mark.parametrize(("size", "hfov_deg"), [((1280, 720), 60.0), ((720, 720), 60.0), ((720, 1280), 36.0)])
def test_an_assumed_field_of_view_is_that_of_the_longer_side(size, hfov_deg):
    assert FieldOfView(60.0, "", assumed=True).across(size) == pytest.approx(hfov_deg, abs=0.05)
    assert FieldOfView(50.0, "as given").across(size) == 50.0
