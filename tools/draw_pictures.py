"""Draw the pictures of README.md, project.ipynb and docs/when_it_fails.md again, into
docs/pictures.

    python -m tools.draw_pictures

tracked.webp is an animated WebP of at most 1.5 MB, from the annotated video of the
course. The explained images are stills of the project and frames of the suite; missing
scenes are rendered. Check afterwards that the text of docs/when_it_fails.md still fits
them.
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
SIZE_PX = (640, 360)
QUALITY = 55
# Every second frame of 25 a second shows the motion and keeps the file small.
STEP = 2
# Image -> still and error of its camera pitch, degrees.
STILLS = {"good": ("test4", 0.0), "wrong_pose": ("test6", -3.0)}
# Image -> scene and time of the frame, seconds.
SCENES = {
    "one_line": ("missing-paint", 1.12),
    "no_lines": ("unmarked-road", 0.0),
    "hairpin": ("hairpin-right", 4.4),
}


def animate(video: Path) -> bytes:
    """An animated WebP of every STEP-th frame of a video, endless, at the speed of the
    video.
    """
    frames = []
    for image in islice(read_video(video), 0, None, STEP):
        small = cv2.resize(image, SIZE_PX, interpolation=cv2.INTER_AREA)
        frames.append(Image.fromarray(small))
    animation = io.BytesIO()
    frames[0].save(
        animation,
        "WEBP",
        save_all=True,
        append_images=frames[1:],
        duration=round(1000 * STEP / inspect_video(video).fps),
        loop=0,
        quality=QUALITY,
        method=6,
    )
    return animation.getvalue()


def read_still(name: str, pitch_error_deg: float) -> tuple[np.ndarray, Camera]:
    """A still and its camera, which looks too far down by `pitch_error_deg`."""
    camera = load_camera(PROJECT_ROOT / "test_videos" / "project_video.yaml")
    pitch_rad = camera.pose.pitch_rad + np.radians(pitch_error_deg)
    pose = replace(camera.pose, pitch_rad=pitch_rad)
    image = read_image(PROJECT_ROOT / "test_images" / f"{name}.jpg")
    return image, camera.with_pose(pose)


def read_frame(scene: str, time_s: float) -> tuple[np.ndarray, Camera]:
    """A frame of a scene, and its camera."""
    video = render_scene(scene)
    image = next(read_video(video, start_s=time_s))
    return image, load_camera(video.with_suffix(".yaml"))


def main() -> None:
    """Draw the pictures; print the size of the animation, and the explanations."""
    parser = ArgumentParser(
        description=__doc__, formatter_class=RawDescriptionHelpFormatter
    )
    parser.parse_args()
    for name in SKETCHES:
        figure, *_ = sketch(name)
        print(save_figure(figure, PICTURES / f"sketch_{name}.png"))

    animation = animate(VIDEO)
    write_atomically(PICTURES / "tracked.webp", animation)
    print(f"tracked.webp: {len(animation) / 1e6:.2f} MB")

    images = {}
    for name, (still, pitch_error_deg) in STILLS.items():
        images[name] = read_still(still, pitch_error_deg)
    for name, (scene, time_s) in SCENES.items():
        images[name] = read_frame(scene, time_s)
    for name, (image, camera) in images.items():
        explanation = explain(image, camera)
        figure, _ = show_explanation(explanation)
        print(save_figure(figure, PICTURES / f"explained_{name}.jpg"))
        print(explanation.describe(), end="\n\n")


if __name__ == "__main__":
    main()
