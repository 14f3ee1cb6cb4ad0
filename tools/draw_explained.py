"""Draw the explained pictures of docs/when_it_fails.md anew.

    python -m tools.draw_explained

The pictures are the project's own stills and frames of the suite, rendered where they have not been yet. Look at what
the page says of them afterwards.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

PROJECT = Path(__file__).parents[1]

from lanes.camera.camera import Camera  # noqa: E402
from lanes.camera.camera_file import load_camera  # noqa: E402
from lanes.drawing.figures import save_figure  # noqa: E402
from lanes.explain.explanation import explain_frame  # noqa: E402
from lanes.explain.panels import show_explanation  # noqa: E402
from lanes.io.images import read_image  # noqa: E402
from lanes.io.video.reader import read_frames  # noqa: E402
from simulator.scenes.suite import render_scene  # noqa: E402

# Stills by the error of the camera pose's pitch, degrees; scenes by the second that is shown.
STILLS = {"good": ("test4", 0.0), "wrong_pose": ("test6", -3.0)}
SCENES = {"one_line": ("missing-paint", 1.12), "no_lines": ("unmarked-road", 0.0), "hairpin": ("hairpin-right", 4.4)}


def still(name: str, wrong_deg: float) -> tuple[np.ndarray, Camera]:
    """A picture, and its camera with a camera pose that looks so much farther down than it does."""
    camera = load_camera(PROJECT / "test_videos" / "project_video.yaml")
    pose = replace(camera.pose, pitch_rad=camera.pose.pitch_rad + np.radians(wrong_deg))
    return read_image(PROJECT / "test_images" / f"{name}.jpg"), camera.with_pose(pose)


def frame(scene: str, time_s: float) -> tuple[np.ndarray, Camera]:
    """A frame of a scene, and its camera."""
    video = render_scene(scene)
    return next(read_frames(video, start_s=time_s)), load_camera(video.with_suffix(".yaml"))


def main() -> None:
    """Draw, and print what the pictures say."""
    shown = {name: still(*what) for name, what in STILLS.items()} | {n: frame(*what) for n, what in SCENES.items()}
    for name, (image, camera) in shown.items():
        explanation = explain_frame(image, camera)
        figure, _ = show_explanation(explanation)
        print(save_figure(figure, PROJECT / "docs" / "pictures" / f"explained_{name}.jpg"))
        print(explanation.describe(), end="\n\n")


if __name__ == "__main__":
    main()
