"""The benchmark's figures: what of its results goes into which panel."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from lanes.benchmark.reliability import StatedLanes
from lanes.benchmark.scores import Result, Row
from lanes.benchmark.systems import METRIC
from lanes.plots import plot_ranges, plot_reliability, save_figure

ERROR, GIVEN, WRONG = "error over 5-20 m, median to 95 % (m)", "frames with a lane given (%)", "surely wrong frames (%)"
LIMITS = {ERROR: (0.003, 10.0), GIVEN: (0.0, 100.0), WRONG: (0.0, 100.0)}


def save_scores_figure(path: str | Path, rows: Sequence[Row]) -> Path:
    """Draw error, availability and surely wrong frames of each scene, systems side by side."""
    scenes = list(dict.fromkeys(row["scene"] for row in rows))
    systems = list(dict.fromkeys(row["system"] for row in rows))
    cells = {(row["scene"], row["system"]): row for row in rows}

    def values(key: str, system: str) -> np.ndarray:
        return np.array([cells.get((scene, system), {}).get(key, np.nan) for scene in scenes], float)

    panels = {
        ERROR: {s: (values("lateral_5_20m_median_m", s), values("lateral_5_20m_p95_m", s)) for s in systems},
        GIVEN: {s: (100 * values("available_share", s),) * 2 for s in systems},
        WRONG: {s: (100 * values("confidently_wrong_share", s),) * 2 for s in systems},
    }
    figure, _ = plot_ranges(scenes, panels, limits=LIMITS, title="Every system on every scene")
    return save_figure(figure, path)


def save_reliability_figure(path: str | Path, results: Sequence[Result]) -> Path | None:
    """Draw how the metric engine's confidence keeps its word, and precision at coverage; None if it gave no lane."""
    groups = {system: [r.errors for r in results if r.system == system] for system in {r.system: 0 for r in results}}
    stated = {system: StatedLanes.of(errors) for system, errors in groups.items()}
    if METRIC not in stated or not len(stated[METRIC].confidence):
        return None
    bins = stated[METRIC].reliability()
    precisions = {}
    for system, lanes in stated.items():
        if len(lanes.confidence):
            curve = lanes.precision()
            precisions[system] = curve.coverage, curve.precision
    scenes = len({result.scene for result in results})
    title = f"Does the confidence keep its word? ({scenes} scene{'s' * (scenes > 1)})"
    figure, _ = plot_reliability((bins.stated, bins.right, bins.low, bins.high, bins.count), precisions, title=title)
    return save_figure(figure, path)
