"""Show every step from one picture to its lane, with its numbers, in one figure: the horizon and the
view from above, paint, stripes, votes, fit, result; and where it failed, why, and what to do.
Without a camera file, or without a camera pose in it, the camera pose is estimated from the file first.
"""

from __future__ import annotations

import argparse
from pathlib import Path

from lanes.cli.arguments import add_lens, find_lens
from lanes.io.console import bounded_float, progress_line

EXAMPLES = """\
  python -m lanes explain --camera camera.yaml drive.mp4 --at 12.5 -o explained.png
  python -m lanes explain --hfov 60 still.jpg"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The options of this command."""
    parser.add_argument("files", nargs=1, type=Path, metavar="FILE", help="a picture or a video")
    parser.add_argument(
        "--at", type=bounded_float(0), metavar="SECONDS", help="which frame of a video (default: the first)"
    )
    add_lens(parser)
    parser.add_argument("-o", "--output", type=Path, default=Path("explained.png"), help="default: %(default)s")


def run(options: argparse.Namespace) -> int:
    """Explain the picture, print the words and write the figure."""
    from lanes.camera.camera_pose import CameraPose
    from lanes.camera.pose_from_lanes.lane_width import USUAL_HEIGHT_M
    from lanes.camera.pose_from_lanes.pose_estimate import PoseError
    from lanes.camera.pose_from_lanes.pose_from_files import pose_from_drive
    from lanes.drawing.figures import figure_kind, save_figure
    from lanes.explain.explanation import explain_frame
    from lanes.explain.panels import show_explanation

    figure_kind(options.output)
    file = options.files[0]
    image = _read_frame(file, options.at)
    camera = find_lens(options)
    trouble = ""
    camera.require_size(image, file)
    try:
        camera, estimate = pose_from_drive(camera, options.files, progress=progress_line("pose"))
        if estimate:
            print(estimate.describe())
    except PoseError as error:
        camera, trouble = camera.with_pose(CameraPose(USUAL_HEIGHT_M)), str(error)
    explanation = explain_frame(image, camera, pose_trouble=trouble)
    print(explanation.describe())
    figure, _ = show_explanation(explanation)
    print(f"wrote {save_figure(figure, options.output)}")
    return 0


def _read_frame(file: Path, at_s: float | None):
    """The picture, or the frame of a video that is shown at `at_s`."""
    from lanes.io.frames import PictureError
    from lanes.io.images import PICTURE_SUFFIXES, read_image
    from lanes.io.video.reader import read_frames

    if file.suffix.lower() not in PICTURE_SUFFIXES:
        return next(read_frames(file, start_s=at_s or 0.0))
    if at_s is not None:
        raise PictureError(f"{file}: is a single picture, which has no frame at {at_s:g} s; leave --at out.")
    return read_image(file)
