"""Plot every step of the lane detection in one picture, with its numbers: horizon, bird's-eye view,
marking response, stripes, votes, fit and result. If a step failed, the figure and the printed text say
why, and what to do. If no camera file with a camera pose is given, the pose is first estimated from the
picture or video.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from lanes.cli.arguments import add_lens, add_output, find_lens
from lanes.console import bounded_float, progress_line

if TYPE_CHECKING:
    import numpy as np

EXAMPLES = """\
  {program} --camera camera.yaml drive.mp4 --at 12.5 -o explained.png
  {program} --hfov 60 still.jpg"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The options of this command."""
    parser.add_argument("files", nargs=1, type=Path, metavar="FILE", help="picture or video")
    parser.add_argument(
        "--at", type=bounded_float(0), metavar="SECONDS", help="time of the frame in a video (default: first frame)"
    )
    add_lens(parser)
    add_output(parser, "explained.png", "figure to write")


def run(options: argparse.Namespace) -> int:
    """Explain the picture, print the text, and write the figure."""
    from lanes.camera import CameraPose
    from lanes.errors import PoseError
    from lanes.explain import explain
    from lanes.figures import figure_kind, save_figure, show_explanation
    from lanes.files import require_no_input_among
    from lanes.pose import PRIOR_HEIGHT_M, ensure_pose

    figure_kind(options.output)
    require_no_input_among([options.output], options.files)
    file = options.files[0]
    image = _read_frame(file, options.at)
    camera = find_lens(options)
    estimate, pose_failure = None, ""
    try:
        camera, estimate = ensure_pose(camera, options.files, progress=progress_line("pose"))
        if estimate:
            print(estimate.describe())
    except PoseError as error:
        camera, pose_failure = camera.with_pose(CameraPose(PRIOR_HEIGHT_M)), str(error)
    detection = estimate.still if estimate and options.at is None else None
    explanation = explain(image, camera, detection=detection, pose_failure=pose_failure)
    print(explanation.describe())
    figure, _ = show_explanation(explanation)
    print(f"wrote {save_figure(figure, options.output)}")
    return 0


def _read_frame(file: Path, at_s: float | None) -> np.ndarray:
    """The picture, or the frame of a video at time `at_s`."""
    from lanes.errors import PictureError
    from lanes.images import PICTURE_SUFFIXES, read_image
    from lanes.video.reader import read_video

    if file.suffix.lower() not in PICTURE_SUFFIXES:
        return next(read_video(file, start_s=at_s or 0.0))
    if at_s is not None:
        raise PictureError(f"{file}: is a single picture, which has no frame at {at_s:g} s; omit --at.")
    return read_image(file)
