"""Advanced Lane Finding, chapter by chapter: every name that project.ipynb uses.

Each function lives in the module of `lanes` named beside its chapter and is documented there
(`help(helpers.undistort)`); this file only brings them together.

Data             open_dataset, check, PROJECT_ROOT                                          lanes.dataset
1 Why            read_image, write_image, list_pictures                                     lanes.images
2 Calibrate      find_board, draw_board, calibrate_folder                                   lanes.calibration.boards
                 Camera, Mount                                                              lanes.camera
                 save_camera, load_camera                                                   lanes.camerafile
3 Undistort      undistort                                                                  lanes.camera
4 From above     FourPointWarp, metres_per_pixel, view_to_road                              lanes.classic.view
                 estimate_mount, mount_camera                                               lanes.mounting.mount
                 pick_pictures                                                              lanes.video.footage
5 Thresholds     split_channels, to_gray, range_mask, gradient_x_mask, magnitude_mask,
                 direction_mask, saturation_mask, yellow_mask, equalized_white_mask         lanes.classic.threshold
                 RECIPES, get_recipe, LaneFinder                                            lanes.classic.recipes
                 binary_on_road, paint_share, line_coverage                                 lanes.benchmark.measures
6 Find           lane_histogram, find_peaks, sliding_windows, search_band                   lanes.classic.search
7 Fit, measure   fit_line, ransac_line                                                      lanes.classic.fit
                 describe_bend, describe_offset                                             lanes.words
                 worst_lateral_error_m, describe_error, drive_errors_m                      lanes.benchmark.measures
                 format_table                                                               lanes.benchmark.tables
8 Draw, video    LEFT, RIGHT, draw_line, draw_lane, draw_pixels, draw_windows, draw_fit     lanes.draw
                 annotate, describe_result, diagnose, draw_search, follow_lane              lanes.classic.overlay
                 open_clip, annotate_video                                                  lanes.video.annotate
                 read_telemetry                                                             lanes.video.telemetry
9 Metres         RoadView                                                                   lanes.metric.roadview
10 Paint         measure_paint, find_stripes                                                lanes.metric.evidence
11 One model     find_lane                                                                  lanes.metric.lane
                 draw_found                                                                 lanes.metric.lane_overlay
                 annotate_folder                                                            lanes.drives.drive
12 Memory        LaneTracker                                                                lanes.metric.tracker
                 track_lane                                                                 lanes.drives.styles
                 integrate_path                                                             lanes.metric.path
13 Explain       explain_frame                                                              lanes.explain.frame
                 show_explanation                                                           lanes.explain.panels
14 How wrong     score_video                                                                lanes.benchmark.runner
                 results_table                                                              lanes.benchmark.tables
Sliders          tune_threshold, tune_view                                                  lanes.tuning
                 read_frames                                                                lanes.video.videofile
Figures          show_pictures, plot_bars, plot_histogram, plot_series, plot_telemetry,
                 plot_path, save_figure                                                     lanes.plots
"""

from lanes.benchmark.measures import (
    binary_on_road,
    describe_error,
    drive_errors_m,
    line_coverage,
    paint_share,
    worst_lateral_error_m,
)
from lanes.benchmark.runner import score_video
from lanes.benchmark.tables import format_table, results_table
from lanes.calibration.boards import calibrate_folder, draw_board, find_board
from lanes.camera import Camera, Mount, undistort
from lanes.camerafile import load_camera, save_camera
from lanes.classic.fit import fit_line, ransac_line
from lanes.classic.overlay import annotate, describe_result, diagnose, draw_search, follow_lane
from lanes.classic.recipes import RECIPES, LaneFinder, get_recipe
from lanes.classic.search import find_peaks, lane_histogram, search_band, sliding_windows
from lanes.classic.threshold import (
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
from lanes.classic.view import FourPointWarp, metres_per_pixel, view_to_road
from lanes.dataset import PROJECT_ROOT, check, open_dataset
from lanes.draw import LEFT, RIGHT, draw_fit, draw_lane, draw_line, draw_pixels, draw_windows
from lanes.drives.drive import annotate_folder
from lanes.drives.styles import track_lane
from lanes.explain.frame import explain_frame
from lanes.explain.panels import show_explanation
from lanes.images import list_pictures, read_image, write_image
from lanes.metric.evidence import find_stripes, measure_paint
from lanes.metric.lane import find_lane
from lanes.metric.lane_overlay import draw_found
from lanes.metric.path import integrate_path
from lanes.metric.roadview import RoadView
from lanes.metric.tracker import LaneTracker
from lanes.mounting.mount import estimate_mount, mount_camera
from lanes.plots import (
    plot_bars,
    plot_histogram,
    plot_path,
    plot_series,
    plot_telemetry,
    save_figure,
    show_pictures,
)
from lanes.tuning import tune_threshold, tune_view
from lanes.video.annotate import annotate_video, open_clip
from lanes.video.footage import pick_pictures
from lanes.video.telemetry import read_telemetry
from lanes.video.videofile import read_frames
from lanes.words import describe_bend, describe_offset

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
    "explain_frame",
    "find_board",
    "find_lane",
    "find_peaks",
    "find_stripes",
    "fit_line",
    "follow_lane",
    "format_table",
    "get_recipe",
    "gradient_x_mask",
    "integrate_path",
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
    "plot_path",
    "plot_series",
    "plot_telemetry",
    "range_mask",
    "ransac_line",
    "read_frames",
    "read_image",
    "read_telemetry",
    "saturation_mask",
    "results_table",
    "save_camera",
    "score_video",
    "save_figure",
    "search_band",
    "show_explanation",
    "show_pictures",
    "sliding_windows",
    "split_channels",
    "to_gray",
    "track_lane",
    "tune_threshold",
    "tune_view",
    "undistort",
    "view_to_road",
    "worst_lateral_error_m",
    "write_image",
    "yellow_mask",
]
