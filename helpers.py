"""Advanced Lane Finding, chapter by chapter: every name that project.ipynb uses.

Each function lives in the module of `lanes` named beside its chapter and is documented there
(`help(helpers.undistort)`); this file only brings them together.

Data             open_dataset, check, PROJECT_ROOT                                          lanes.dataset
1 Why            read_image, write_image, list_pictures                                     lanes.images
2 Calibrate      find_board, draw_board, calibrate_folder                                   lanes.boards
                 Camera, Mount, save_camera, load_camera                                    lanes.camera
3 Undistort      undistort                                                                  lanes.camera
4 From above     FourPointWarp, metres_per_pixel, view_to_road                              lanes.view
                 estimate_mount, mount_camera                                               lanes.mount
                 pick_pictures                                                              lanes.footage
5 Thresholds     split_channels, to_gray, range_mask, gradient_x_mask, magnitude_mask,
                 direction_mask, saturation_mask, yellow_mask, equalized_white_mask         lanes.threshold
                 RECIPES, get_recipe, LaneFinder                                            lanes.recipes
                 binary_on_road, paint_share, line_coverage                                 lanes.benchmark
6 Find           lane_histogram, find_peaks, sliding_windows, search_band                   lanes.search
7 Fit, measure   fit_line, ransac_line                                                      lanes.fit
                 describe_bend, describe_offset                                             lanes.measure
                 worst_lateral_error_m, describe_error, drive_errors_m, format_table        lanes.benchmark
8 Draw, video    LEFT, RIGHT, draw_line, draw_lane, draw_pixels, draw_windows, draw_fit     lanes.draw
                 annotate, describe_result, diagnose, draw_search, follow_lane              lanes.overlay
                 open_clip, annotate_video                                                  lanes.video
                 read_telemetry                                                             lanes.telemetry
9 Metres         RoadView                                                                   lanes.roadview
10 Paint         measure_paint, find_stripes                                                lanes.evidence
11 One model     find_lane                                                                  lanes.lane
                 draw_found, annotate_folder                                                lanes.lane_overlay
12 Memory        LaneTracker                                                                lanes.tracker
                 track_lane                                                                 lanes.lane_overlay
                 read_frames                                                                lanes.videofile
Figures          show_pictures, plot_bars, plot_histogram, plot_series, save_figure         lanes.plots
"""

from lanes.benchmark import (
    binary_on_road,
    describe_error,
    drive_errors_m,
    format_table,
    line_coverage,
    paint_share,
    worst_lateral_error_m,
)
from lanes.boards import calibrate_folder, draw_board, find_board
from lanes.camera import Camera, Mount, load_camera, save_camera, undistort
from lanes.dataset import PROJECT_ROOT, check, open_dataset
from lanes.draw import LEFT, RIGHT, draw_fit, draw_lane, draw_line, draw_pixels, draw_windows
from lanes.evidence import find_stripes, measure_paint
from lanes.fit import fit_line, ransac_line
from lanes.footage import pick_pictures
from lanes.images import list_pictures, read_image, write_image
from lanes.lane import find_lane
from lanes.lane_overlay import annotate_folder, draw_found, track_lane
from lanes.measure import describe_bend, describe_offset
from lanes.mount import estimate_mount, mount_camera
from lanes.overlay import annotate, describe_result, diagnose, draw_search, follow_lane
from lanes.plots import plot_bars, plot_histogram, plot_series, save_figure, show_pictures
from lanes.recipes import RECIPES, LaneFinder, get_recipe
from lanes.roadview import RoadView
from lanes.search import find_peaks, lane_histogram, search_band, sliding_windows
from lanes.telemetry import read_telemetry
from lanes.threshold import (
    direction_mask,
    equalized_white_mask,
    gradient_x_mask,
    magnitude_mask,
    range_mask,
    saturation_mask,
    split_channels,
    to_gray,
    yellow_mask,
)
from lanes.tracker import LaneTracker
from lanes.video import annotate_video, open_clip
from lanes.videofile import read_frames
from lanes.view import FourPointWarp, metres_per_pixel, view_to_road

__all__ = [
    "Camera",
    "FourPointWarp",
    "LEFT",
    "LaneFinder",
    "LaneTracker",
    "Mount",
    "PROJECT_ROOT",
    "RECIPES",
    "RIGHT",
    "RoadView",
    "annotate",
    "annotate_folder",
    "annotate_video",
    "binary_on_road",
    "calibrate_folder",
    "check",
    "describe_bend",
    "describe_error",
    "describe_offset",
    "describe_result",
    "diagnose",
    "direction_mask",
    "draw_board",
    "draw_fit",
    "draw_found",
    "draw_lane",
    "draw_line",
    "draw_pixels",
    "draw_search",
    "draw_windows",
    "drive_errors_m",
    "equalized_white_mask",
    "estimate_mount",
    "find_board",
    "find_lane",
    "find_peaks",
    "find_stripes",
    "fit_line",
    "follow_lane",
    "format_table",
    "get_recipe",
    "gradient_x_mask",
    "lane_histogram",
    "line_coverage",
    "list_pictures",
    "load_camera",
    "magnitude_mask",
    "metres_per_pixel",
    "measure_paint",
    "mount_camera",
    "open_clip",
    "open_dataset",
    "paint_share",
    "pick_pictures",
    "plot_bars",
    "plot_histogram",
    "plot_series",
    "range_mask",
    "ransac_line",
    "read_frames",
    "read_image",
    "read_telemetry",
    "saturation_mask",
    "save_camera",
    "save_figure",
    "search_band",
    "show_pictures",
    "sliding_windows",
    "split_channels",
    "to_gray",
    "track_lane",
    "undistort",
    "view_to_road",
    "worst_lateral_error_m",
    "write_image",
    "yellow_mask",
]
