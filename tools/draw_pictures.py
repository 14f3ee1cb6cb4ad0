"""Draw the pictures of README.md, project.ipynb and docs/when_it_fails.md again, into docs/pictures.

    python -m tools.draw_pictures

tracked.webp is an animated WebP of at most 1.5 MB, from the annotated video of the course. The explained images are
stills of the project and frames of the suite; missing scenes are rendered. Check afterwards that the text of
docs/when_it_fails.md still fits them.
"""

from __future__ import annotations

import io
from argparse import ArgumentParser, RawDescriptionHelpFormatter
from dataclasses import replace
from itertools import islice
from pathlib import Path

import cv2
import numpy as np
from PIL import Image

from benchmark.evaluation import PROJECT_ROOT
from course.sketch import SKETCHES, sketch
from lanes.camera.model import Camera, load_camera
from lanes.files import write_atomically
from lanes.show.explanation import explain
from lanes.show.figures import save_figure, show_explanation
from lanes.video.images import read_image
from lanes.video.reader import inspect_video, read_video
from simulator.scenes.suite import render_scene

VIDEO = PROJECT_ROOT / "output_images" / "project_video_tracked.mp4"
PICTURES = PROJECT_ROOT / "docs" / "pictures"
SIZE_PX, QUALITY = (640, 360), 55
# Every second frame of 25 a second shows the motion and keeps the file small.
STEP = 2
# Image -> still and error of its camera pitch, degrees.
STILLS = {"good": ("test4", 0.0), "wrong_pose": ("test6", -3.0)}
# Image -> scene and time of the frame, seconds.
SCENES = {"one_line": ("missing-paint", 1.12), "no_lines": ("unmarked-road", 0.0), "hairpin": ("hairpin-right", 4.4)}


def animate(video: Path) -> bytes:
    """An animated WebP of every STEP-th frame of a video, endless, at the speed of the video."""
    some = islice(read_video(video), 0, None, STEP)
    frames = [Image.fromarray(cv2.resize(frame, SIZE_PX, interpolation=cv2.INTER_AREA)) for frame in some]
    duration_ms, animation = round(1000 * STEP / inspect_video(video).fps), io.BytesIO()
    looks = {"duration": duration_ms, "loop": 0, "quality": QUALITY, "method": 6}
    frames[0].save(animation, "WEBP", save_all=True, append_images=frames[1:], **looks)
    return animation.getvalue()


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
    """Draw the pictures; print the size of the animation, and the explanations."""
    ArgumentParser(description=__doc__, formatter_class=RawDescriptionHelpFormatter).parse_args()
    for name in SKETCHES:
        print(save_figure(sketch(name)[0], PICTURES / f"sketch_{name}.png"))
    animation = animate(VIDEO)
    write_atomically(PICTURES / "tracked.webp", animation)
    print(f"tracked.webp: {len(animation) / 1e6:.2f} MB")
    images = {name: read_still(*still) for name, still in STILLS.items()}
    images |= {name: read_frame(*frame) for name, frame in SCENES.items()}
    for name, (image, camera) in images.items():
        explanation = explain(image, camera)
        figure, _ = show_explanation(explanation)
        print(save_figure(figure, PICTURES / f"explained_{name}.jpg"))
        print(explanation.describe(), end="\n\n")


if __name__ == "__main__":
    main()
