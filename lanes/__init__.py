"""Finds the ego lane in images and videos of a road, in metres and with its
uncertainty.

A road is drawn here; `read_image` reads a real one.

>>> import cv2, lanes, numpy as np
>>> pose = lanes.CameraPose(height_m=1.3, pitch_rad=0.05)
>>> camera = lanes.Camera.from_fov((640, 360), hfov_deg=60).with_pose(pose)
>>> image = np.full((360, 640, 3), 90, np.uint8)
>>> yellow, white = (220, 180, 60), (230, 230, 230)
>>> for y, colour in ((1.9, yellow), (-1.6, white)):  # two lines, 3.5 m apart
...     left, right = y + 0.07, y - 0.07
...     on_road = np.array([[4, left], [60, left], [60, right], [4, right]])
...     corners = camera.road_to_pixels(on_road).round().astype(np.int32)
...     _ = cv2.fillPoly(image, [corners], colour)
>>> lane = lanes.find_lane(image, camera)
>>> print(f"{lane.width_m:.1f} m wide, {lane.offset_m:.2f} m left of the centre")
3.5 m wide, -0.15 m left of the centre
>>> print(lane.left.colour, lane.left.kind)
yellow solid
>>> drawn = lanes.draw_lane(image, lane, camera)

Videos: `track`, `annotate`. Other cameras: `calibrate`, `estimate_pose`. The API is
`__all__`; modules are its inside.
"""

import os
import signal
import sys


def _stop_loading(*_: object) -> None:
    os.write(2, b"\ninterrupted; nothing was written\n")
    os._exit(130)


# Ctrl-C while the modules of a command are loaded, which takes a second, ends it as
# later; `run_program` takes over.
_is_command = sys.orig_argv[1:3] == ["-m", "lanes"]
_is_command |= os.path.basename("".join(sys.orig_argv[1:2])) == "lanes"
if _is_command and signal.getsignal(signal.SIGINT) is signal.default_int_handler:
    signal.signal(signal.SIGINT, _stop_loading)

from lanes.console import require_opencv

require_opencv()  # before modules that use what only OpenCV 5 has

from lanes.camera.calibration import calibrate
from lanes.camera.model import Camera, CameraPose, load_camera, save_camera
from lanes.detect.lane import Lane, Line
from lanes.detect.search import find_lane
from lanes.drive import annotate, track
from lanes.errors import CameraError, LaneError, PictureError, PoseError, VideoError
from lanes.pose.estimate import estimate_pose
from lanes.show.draw import draw_lane
from lanes.show.explanation import explain
from lanes.tracking.tracker import LaneTracker, TrackerSettings
from lanes.video.images import read_image
from lanes.video.reader import TimedFrame, read_video
from lanes.video.writer import process_video

__version__ = "0.1.0"
__all__ = [
    "Camera",
    "CameraError",
    "CameraPose",
    "Lane",
    "LaneError",
    "LaneTracker",
    "Line",
    "PictureError",
    "PoseError",
    "TimedFrame",
    "TrackerSettings",
    "VideoError",
    "annotate",
    "calibrate",
    "draw_lane",
    "estimate_pose",
    "explain",
    "find_lane",
    "load_camera",
    "process_video",
    "read_image",
    "read_video",
    "save_camera",
    "track",
]
