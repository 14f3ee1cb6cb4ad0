"""The page of a score: its tables, and the worst stills with labels and predictions, which its script draws."""

from __future__ import annotations

import base64
from collections.abc import Mapping, Sequence
from html import escape
from io import BytesIO
from pathlib import Path

from lanes.describe import number_cells
from lanes.images import read_image
from lanes.labels import find_picture
from lanes.report.page import fill_page
from lanes.score import StillScore, Table

# Largest size of the stills in the page, and their JPEG quality: about 100 kB each.
_MAX_SIZE_PX, _JPEG_QUALITY = (960, 960), 80


def write_score_page(
    path: Path, folder: Path, scores: Sequence[StillScore], tables: Mapping[str, Table], words: Mapping[str, str]
) -> Path:
    """Write the page of scores of stills in a folder, with their `score_tables`, a title and notes; returns `path`."""
    stills = [
        _still(s, find_picture(folder, name)) for name in tables["worst stills"] for s in scores if s.label.name == name
    ]
    data = {"tables": {name: number_cells(rows) for name, rows in tables.items()}, "stills": stills}
    return fill_page(path, "score", {name: escape(text) for name, text in words.items()}, data)


def _still(score: StillScore, picture: Path) -> dict:
    """A still with its lines for the script; without JPEG data if its file is missing."""
    from PIL import Image

    jpeg = BytesIO()
    if picture.is_file():
        image = Image.fromarray(read_image(picture))
        image.thumbnail(_MAX_SIZE_PX)
        image.save(jpeg, "JPEG", quality=_JPEG_QUALITY)
    lanes = [(lane.rows, lane.columns, lane.ego_lane(score.size).columns) for lane in (score.label, score.prediction)]
    return {
        "name": score.label.name,
        "right": score.right,
        "confidence": score.prediction.confidence,
        "size": score.size,
        "lanes": [[array.tolist() for array in lane] for lane in lanes],
        "jpeg": base64.b64encode(jpeg.getvalue()).decode(),
    }
