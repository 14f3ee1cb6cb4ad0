"""Draw the animation of README.md again, from the annotated video of the course.

    python -m tools.draw_animation

Writes docs/pictures/tracked.webp, an animated WebP of a few seconds and at most 1.5 MB.
"""

from __future__ import annotations

import io
from argparse import ArgumentParser, RawDescriptionHelpFormatter
from itertools import islice
from pathlib import Path

import cv2
from PIL import Image

from lanes.files import write_atomically
from lanes.video.reader import inspect_video, read_video

PROJECT_ROOT = Path(__file__).parents[1]
VIDEO = PROJECT_ROOT / "output_images" / "project_video_tracked.mp4"
ANIMATION = PROJECT_ROOT / "docs" / "pictures" / "tracked.webp"
SIZE_PX = (640, 360)
# Every second frame of 25 a second shows the motion and keeps the file small.
STEP = 2
QUALITY = 55


def animate(video: Path, *, step: int = STEP, quality: int = QUALITY) -> bytes:
    """An animated WebP of every `step`-th frame of a video, endless, at the speed of the video."""
    frames = [
        Image.fromarray(cv2.resize(frame, SIZE_PX, interpolation=cv2.INTER_AREA))
        for frame in islice(read_video(video), 0, None, step)
    ]
    animation = io.BytesIO()
    duration_ms = round(1000 * step / inspect_video(video).fps)
    frames[0].save(
        animation,
        "WEBP",
        save_all=True,
        append_images=frames[1:],
        duration=duration_ms,
        loop=0,
        quality=quality,
        method=6,
    )
    return animation.getvalue()


def main() -> None:
    """Write the animation and print its size."""
    ArgumentParser(description=__doc__, formatter_class=RawDescriptionHelpFormatter).parse_args()
    animation = animate(VIDEO)
    write_atomically(ANIMATION, animation)
    print(f"{ANIMATION.relative_to(PROJECT_ROOT)}: {len(animation) / 1e6:.2f} MB")


if __name__ == "__main__":
    main()
