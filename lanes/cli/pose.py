"""Estimate the camera pose (height, pitch, yaw and roll) from stills or videos of one drive, and write
it with the lens into a camera file. Use 20 or more pictures of a marked road by day. One picture is
enough, but gives larger standard deviations.
"""

from __future__ import annotations

import argparse

from lanes.cli.arguments import add_footage, add_lens, add_output, add_piece, find_lens, require_piece
from lanes.console import bounded_float, bounded_int, progress_line

EXAMPLES = """\
  {program} --hfov 60 drive.mp4 -o camera.yaml
  {program} --camera lens.yaml --lane-width 3.5 drive/*.jpg -o camera.yaml
  {program} --hfov 60 --start 60 --end 90 drive.mp4
  {program} --boards my_boards --height 1.35 drive.mp4"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The options of this command."""
    add_footage(parser, files="stills or videos of one drive")
    add_lens(parser)
    parser.add_argument(
        "--lane-width",
        type=bounded_float(2, 6),
        metavar="M",
        help="true width of the lanes, metres (default: 3.66, US Interstates)",
    )
    parser.add_argument(
        "--height",
        type=bounded_float(0.5, 4.5),
        metavar="M",
        help="measured height of the camera above the road, metres",
    )
    add_piece(parser)
    parser.add_argument(
        "--pictures",
        type=bounded_int(1),
        default=40,
        metavar="N",
        help="largest number of pictures to use (default: %(default)s)",
    )
    add_output(parser, "camera.yaml", "camera file to write")


def run(options: argparse.Namespace) -> int:
    """Estimate the camera pose, print it, and write it with the lens."""
    from lanes.camera import save_camera
    from lanes.files import require_no_input_among
    from lanes.pose import LANE_WIDTH_M, describe_accuracy, estimate_pose

    require_piece(options)
    require_no_input_among([options.output], options.files)
    estimate = estimate_pose(
        options.files,
        find_lens(options),
        lane_width_m=options.lane_width or LANE_WIDTH_M,
        height_m=options.height,
        max_pictures=options.pictures,
        start_s=options.start,
        end_s=options.end,
        progress=progress_line("pose"),
    )
    print(estimate.describe())
    print(describe_accuracy(estimate))
    print(f"wrote {save_camera(estimate.camera, options.output)}")
    return 0
