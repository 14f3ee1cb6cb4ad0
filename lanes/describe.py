"""Measurements as text.

Signs: curvature > 0 bends left; offset > 0 means the car is left of the lane centre.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import degrees


def describe_bend(curvature_per_m: float | None, std_per_m: float = 0.0) -> str:
    """Text for a curvature: "bends right, R 640 m", "straight (R > 3 km)" or "bend
    unknown".

    If the curvature is smaller than its standard deviation, the road is straight, or
    bends with a larger radius than the text says. If that radius is below 100 m, the
    bend is unknown.
    """
    if curvature_per_m is None:
        return "bend unknown"
    # On a straight road the measured radius is large and of either sign. At 3 km a line
    # leaves its tangent by 0.15 m, the width of a marking, over the 30 m that the
    # classic views show.
    least_per_m = 1 / 3000
    size_per_m = abs(curvature_per_m)
    if size_per_m < max(std_per_m, least_per_m):
        most_per_m = size_per_m + std_per_m
        if most_per_m > 1 / 100:
            return "bend unknown"
        radius_m = 1 / max(most_per_m, least_per_m)
        if radius_m >= 1000:
            return f"straight (R > {radius_m / 1000:.0f} km)"
        return f"straight (R > {round(radius_m, -2):.0f} m)"
    # It is accurate to a few per cent.
    radius_m = 1 / size_per_m
    digits = -1 if radius_m >= 100 else 0
    side = "left" if curvature_per_m > 0 else "right"
    return f"bends {side}, R {round(radius_m, digits):.0f} m"


def describe_offset(offset_m: float | None, std_m: float | None = None) -> str:
    """Text for an offset: "0.12 m left of centre", "in the centre" or "offset unknown".

    With a standard deviation: "0.12 ± 0.02 m left of centre"; see `describe_std`.
    """
    if offset_m is None:
        return "offset unknown"
    side = "left" if offset_m > 0 else "right"
    size_m = abs(offset_m)
    if std_m is not None:
        return f"{size_m:.2f} ± {describe_std(std_m)} m {side} of centre"
    if size_m < 0.005:
        return "in the centre"
    return f"{size_m:.2f} m {side} of centre"


def describe_std(std_m: float) -> str:
    """Text for a standard deviation of centimetres: "0.02".

    At least "0.01", because "± 0.00" would claim certainty.
    """
    return f"{max(std_m, 0.01):.2f}"


def describe_heading(heading_rad: float) -> str:
    """Text for the road's direction relative to the car: "0.6 deg to the left" or
    "straight ahead".
    """
    heading_deg = abs(degrees(heading_rad))
    if heading_deg < 0.05:
        return "straight ahead"
    side = "left" if heading_rad > 0 else "right"
    return f"{heading_deg:.1f} deg to the {side}"


def format_table(columns: Sequence[str], rows: Mapping[str, Sequence[str]]) -> str:
    """A text table with columns of equal width: a line of headings, then a line for
    each named row.
    """
    texts = [*columns]
    for cells in rows.values():
        texts += cells
    width = 2 + max(map(len, texts))
    name_width = max(map(len, rows), default=0)
    lines = []
    for name, cells in [("", columns), *rows.items()]:
        line = name.ljust(name_width)
        for text in cells:
            line += text.rjust(width)
        lines.append(line)
    return "\n".join(lines)


def number_cells(
    rows: Mapping[str, Mapping[str, float]],
) -> tuple[list[str], dict[str, list[str]]]:
    """Headings and cells of rows of numbers, for `format_table`; "-" for NaN."""
    cells = {}
    for name, row in rows.items():
        cells[name] = [_number_cell(number) for number in row.values()]
    first = next(iter(rows.values()))
    return list(first), cells


def _number_cell(number: float) -> str:
    if type(number) is not float:  # a count
        return str(number)
    return f"{number:.3f}".replace("nan", "-")
