"""The field of view of an uncalibrated camera: from EXIF or assumed."""

from __future__ import annotations

from pathlib import Path

import pytest
from PIL import Image

from lanes.field_of_view import find_field_of_view, read_hfov

EXIF_BLOCK = 0x8769


def photo(path: Path, size: tuple[int, int] = (640, 360), **entries: object) -> Path:
    """A JPEG with these entries of the camera's settings."""
    numbers = {"focal_mm": 0x920A, "focal_35mm": 0xA405, "plane": 0xA20E, "unit": 0xA210, "stored": 0xA002}
    exif = Image.Exif()
    exif[0x010F] = "maker"
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
            # 4.25 mm before a sensor of 4000 px on 5.6 mm, resized to 640 px
            ((640, 360), {"focal_mm": 4.25, "plane": 40000 / 5.6, "unit": 3, "stored": 4000}, 66.8),
            ((640, 360), {"focal_mm": 4.25, "plane": 640 / 5.6 * 25.4, "unit": 2}, 66.8),
        ],
    )
    def test_the_focal_length_becomes_an_angle(self, tmp_path, size, entries, hfov_deg):
        assert read_hfov(photo(tmp_path / "a.jpg", size, **entries)) == pytest.approx(hfov_deg, abs=0.1)

    @pytest.mark.parametrize(
        "entries",
        [{}, {"focal_mm": 4.2}, {"focal_35mm": 0}, {"focal_35mm": 4000}, {"focal_mm": 4, "plane": 100.0, "unit": 9}],
    )
    def test_insufficient_entries_give_none(self, tmp_path, entries):
        assert read_hfov(photo(tmp_path / "a.jpg", **entries)) is None

    def test_no_picture_at_all(self, tmp_path):
        (tmp_path / "a.jpg").write_bytes(b"nothing")
        assert read_hfov(tmp_path / "a.jpg") is None

    def test_the_first_still_with_the_entries_is_used(self, tmp_path):
        files = [photo(tmp_path / "a.jpg"), tmp_path / "drive.mp4", photo(tmp_path / "b.jpg", focal_35mm=28)]
        found = find_field_of_view(files)
        assert found.hfov_deg == pytest.approx(67.9, abs=0.1)
        assert found.describe() == "field of view 67.9 deg, as b.jpg says (EXIF)"

    def test_without_entries_the_default_comes_with_a_warning(self, tmp_path):
        found = find_field_of_view([photo(tmp_path / "a.jpg")])
        assert (found.hfov_deg, found.assumed) == (60.0, True)
        assert "assumed" in found.describe() and "1.5 times too strong" in found.describe()
