"""The command line: python -m lanes <command>."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path


def main(arguments: list[str] | None = None) -> int:
    """Run a command; returns the exit status (0 done, 1 could not be done, 2 wrong usage)."""
    parser = argparse.ArgumentParser(prog="python -m lanes", description="Find the lane, measure it, draw it.")
    commands = parser.add_subparsers(dest="command", required=True)
    render = commands.add_parser("render", help="render the embedded pictures and video again, with their truth")
    render.add_argument("what", nargs="?", default="all", choices=("boards", "stills", "video", "all"))
    render.add_argument("--out", type=Path, default=Path("."), help="folder to write into (default: here)")
    render.set_defaults(run=run_render)
    _add_mount(commands)
    _add_detect(commands)
    options = parser.parse_args(arguments)
    try:
        return options.run(options)
    except (OSError, ValueError) as error:
        print(f"error: {error}", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        print("\ninterrupted; nothing half-written was left behind", file=sys.stderr)
        return 130


def run_render(options: argparse.Namespace) -> int:
    """Render boards, stills, video or all of them into `options.out`."""
    from lanes.scenes.boards import write_boards
    from lanes.scenes.produce import write_stills, write_video

    jobs = {
        "boards": lambda report: write_boards(options.out / "camera_cal", progress=report),
        "stills": lambda report: write_stills(options.out / "test_images", progress=report),
        "video": lambda report: write_video(options.out / "test_videos" / "project_video.mp4", progress=report),
    }
    for name, job in jobs.items():
        if options.what in (name, "all"):
            written = job(_progress_line(name))
            print(f"{name}: wrote {', '.join(str(path) for path in written[-3:])}, {len(written)} files in all")
    return 0


def _add_mount(commands: argparse._SubParsersAction) -> None:
    mount = commands.add_parser(
        "mount",
        help="estimate how the camera sits on the car, from its own pictures",
        description="Estimate height, pitch, yaw and roll of the camera from stills or videos of one drive, and write "
        "them, with the lens, into a camera file. Best are 20 pictures or more of a marked road by day; one will do, "
        "less surely.",
    )
    _add_footage(mount, files="stills or videos of one drive", camera="the calibrated lens")
    mount.add_argument("--lane-width", type=float, metavar="M", help="lane width (default: 3.66, a US Interstate's)")
    mount.add_argument("--height", type=float, metavar="M", help="measured height of the camera above the road")
    mount.add_argument("--pictures", type=_count, default=40, metavar="N", help="use at most (default: %(default)s)")
    mount.add_argument("-o", "--output", type=Path, default=Path("camera.yaml"), help="default: %(default)s")
    mount.set_defaults(run=run_mount)


def run_mount(options: argparse.Namespace) -> int:
    """Estimate the mount, print it and write it with the lens into `options.output`."""
    from lanes.camera import save_camera
    from lanes.mounting.mount import LANE_WIDTH_M, estimate_mount
    from lanes.video.footage import pick_pictures

    camera = _lens(options)
    estimate = estimate_mount(
        pick_pictures(options.files, options.pictures, camera),
        camera,
        lane_width_m=LANE_WIDTH_M if options.lane_width is None else options.lane_width,
        height_m=options.height,
        progress=_progress_line("mount"),
    )
    print(estimate.describe())
    print(f"wrote {save_camera(camera.with_mount(estimate.mount), options.output)}")
    return 0


def _add_detect(commands: argparse._SubParsersAction) -> None:
    detect = commands.add_parser(
        "detect",
        help="find the ego lane's lines in pictures and videos, as TuSimple JSON lines",
        description="Write the columns of the ego lane's two lines at given rows of the raw pictures, one JSON line a "
        "picture: raw_file, h_samples, lanes (left, right; -2 where there is none), run_time (ms), state, confidence, "
        "offset_m (> 0: car left of the middle), curvature_per_m (> 0 bends left). Without a camera file, "
        "or without a mount in it, the mount is estimated from the given files first.",
    )
    _add_footage(detect, files="stills or videos of one camera", camera="the calibrated camera, best with its mount")
    detect.add_argument("--rows", type=_rows, default="420:701:10", metavar="FROM:TO:STEP", help="default: %(default)s")
    detect.add_argument("--sequence", action="store_true", help="the stills are consecutive frames, in this order")
    detect.add_argument("--fps", type=float, default=25.0, help="frames a second of --sequence (default: %(default)s)")
    detect.add_argument("-o", "--output", type=Path, default=Path("lanes.jsonl"), help="default: %(default)s")
    detect.set_defaults(run=run_detect)


def run_detect(options: argparse.Namespace) -> int:
    """Find the lane in every picture and write `options.output`."""
    from lanes.metric.detect import detect_files, write_detections
    from lanes.mounting.mount import estimate_mount
    from lanes.video.footage import pick_pictures

    camera = _lens(options)
    if camera.mount is None:
        estimate = estimate_mount(pick_pictures(options.files, 40, camera), camera, progress=_progress_line("mount"))
        camera = camera.with_mount(estimate.mount)
        print(estimate.describe())
    found = detect_files(
        options.files,
        camera,
        options.rows,
        sequence=options.sequence,
        fps=options.fps,
        progress=_progress_line("detect"),
    )
    lost = sum(detection["state"] == "lost" for detection in found)
    print(f"wrote {write_detections(options.output, found)}: {len(found)} pictures, no lane in {lost}")
    return 0


def _add_footage(command: argparse.ArgumentParser, *, files: str, camera: str) -> None:
    """The files that a command looks at and the lens that took them; the texts are its help."""
    command.add_argument("files", nargs="+", type=Path, metavar="FILE", help=files)
    lens = command.add_mutually_exclusive_group(required=True)
    lens.add_argument("--camera", type=Path, metavar="YAML", help=camera)
    lens.add_argument("--hfov", type=float, metavar="DEG", help="horizontal field of view, if never calibrated")
    command.add_argument(
        "--size", type=_size, metavar="WxH", help="picture size for --hfov (default: the first file's)"
    )


def _lens(options: argparse.Namespace):
    """The camera that --camera names, or one of --hfov and --size."""
    from lanes.camera import Camera, load_camera
    from lanes.video.footage import pick_pictures

    if options.camera:
        return load_camera(options.camera)
    first = next(pick_pictures(options.files, 1))
    return Camera.from_fov(options.size or (first.shape[1], first.shape[0]), options.hfov)


def _rows(text: str) -> range:
    try:
        rows = range(*(int(number) for number in text.split(":")))
    except (TypeError, ValueError) as error:
        raise argparse.ArgumentTypeError(f"{text} is no row range; write it like 420:701:10") from error
    if ":" not in text or not rows or min(rows) < 0:
        raise argparse.ArgumentTypeError(f"{text} holds no rows of a picture; write it like 420:701:10")
    return rows


def _size(text: str) -> tuple[int, int]:
    width, _, height = text.lower().partition("x")
    if not (width.isdecimal() and height.isdecimal() and int(width) and int(height)):
        raise argparse.ArgumentTypeError(f"{text} is no picture size; write it like 1280x720")
    return int(width), int(height)


def _count(text: str) -> int:
    if not (text.isdecimal() and int(text)):
        raise argparse.ArgumentTypeError(f"{text} is no number of pictures; give 1 or more")
    return int(text)


def _progress_line(name: str):
    """A callback (done, total) that keeps one line on the terminal up to date."""

    def report(done: int, total: int) -> None:
        print(f"\r{name}: {done} of {total}", end="\n" if done == total else "", file=sys.stderr, flush=True)

    return report


if __name__ == "__main__":
    sys.exit(main())
