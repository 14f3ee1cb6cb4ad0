"""Draw the explained pictures of docs/when_it_fails.md again.

    python -m tools.draw_explained

The pictures are stills of the project and frames of the suite; missing scenes are rendered. Check afterwards that the
text of the page still fits the pictures.
"""

from __future__ import annotations

from argparse import ArgumentParser, RawDescriptionHelpFormatter
from dataclasses import replace

import numpy as np

from benchmark.scored_drive import PROJECT_ROOT
from lanes.camera import Camera, load_camera
from lanes.explain import explain_frame
from lanes.figures import save_figure, show_explanation
from lanes.images import read_image
from lanes.video.reader import read_video
from simulator.scenes.suite import render_scene

# Picture -> still and error of its camera pitch, degrees.
STILLS = {"good": ("test4", 0.0), "wrong_pose": ("test6", -3.0)}
# Picture -> scene and time of the frame, seconds.
SCENES = {"one_line": ("missing-paint", 1.12), "no_lines": ("unmarked-road", 0.0), "hairpin": ("hairpin-right", 4.4)}


def read_still(name: str, pitch_error_deg: float) -> tuple[np.ndarray, Camera]:
    """A still and its camera, whose pitch is too large by `pitch_error_deg` (too far down)."""
    camera = load_camera(PROJECT_ROOT / "test_videos" / "project_video.yaml")
    pose = replace(camera.pose, pitch_rad=camera.pose.pitch_rad + np.radians(pitch_error_deg))
    return read_image(PROJECT_ROOT / "test_images" / f"{name}.jpg"), camera.with_pose(pose)


def read_frame(scene: str, time_s: float) -> tuple[np.ndarray, Camera]:
    """A frame of a scene, and its camera."""
    video = render_scene(scene)
    return next(read_video(video, start_s=time_s)), load_camera(video.with_suffix(".yaml"))


def main() -> None:
    """Draw the pictures and print their explanations."""
    ArgumentParser(description=__doc__, formatter_class=RawDescriptionHelpFormatter).parse_args()
    pictures = {name: read_still(*still) for name, still in STILLS.items()}
    pictures |= {name: read_frame(*frame) for name, frame in SCENES.items()}
    for name, (image, camera) in pictures.items():
        explanation = explain_frame(image, camera)
        figure, _ = show_explanation(explanation)
        print(save_figure(figure, PROJECT_ROOT / "docs" / "pictures" / f"explained_{name}.jpg"))
        print(explanation.describe(), end="\n\n")


if __name__ == "__main__":
    main()
