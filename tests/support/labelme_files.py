"""Files of labelme, in the form in which version 6.3.1 writes them."""

from __future__ import annotations

from collections.abc import Sequence


def line_strip(name: str, *points: Sequence[float]) -> dict:
    """A shape; columns and rows count from the corner of the first pixel."""
    return {
        "label": name,
        "points": [list(point) for point in points],
        "group_id": None,
        "description": "",
        "shape_type": "linestrip",
        "flags": {},
        "mask": None,
    }


def labelme_file(image: str, size: tuple[int, int], shapes: Sequence[dict]) -> dict:
    """The content of a file for an image of `size` (width, height)."""
    width, height = size
    return {
        "version": "6.3.1",
        "flags": {},
        "shapes": list(shapes),
        "imagePath": image,
        "imageData": None,
        "imageHeight": height,
        "imageWidth": width,
    }
