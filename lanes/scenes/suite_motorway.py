"""Motorway scenes of the suite."""

from __future__ import annotations

from lanes.scenes.catalogue import project_video
from lanes.scenes.suite_scene import SuiteScene

SCENES = (
    SuiteScene("motorway", "clean", 10.0, "Bends both ways, tree shadows and light concrete by day.", project_video),
)
