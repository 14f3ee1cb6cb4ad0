"""Advanced Lane Finding, chapter by chapter: every name that project.ipynb uses.

Each function is documented in the module that it is imported from (`help(helpers.undistort)`); this file defines
nothing and lists each name once.
"""

# Data
from course.dataset import open_dataset
from benchmark.scored_drive import PROJECT_ROOT
from course.measures import check
from course.exercises.check import check_exercise

# 1 Why
from lanes.images import read_image, write_image, list_pictures

# 2 Calibrate
from lanes import calibrate, load_camera

# 3 Undistort
from lanes.camera import undistort

# 4 From above
from classic.warp import FourPointWarp, metres_per_pixel, birdseye_to_road, road_axes
from classic.recipe import recipe_from_pose
from lanes import estimate_pose
from lanes.sources import sample_images
from course.measures import lane_widths_px
from course.sketch import sketch_conventions

# 5 Thresholds
from classic.threshold import saturation_mask
from classic.recipe import RECIPES, get_recipe
from classic.finder import LaneFinder
from course.measures import binary_on_road, marking_precision, marking_recall

# 6 Find
from classic.search import lane_histogram, find_peaks, sliding_windows, search_band

# 7 Fit, measure
from classic.fit import fit_line, ransac_line
from lanes.describe import describe_bend, describe_offset
from course.accuracy import TwoLines, accuracy_table
from course.measures import worst_lateral_error_m, drive_errors_m
from benchmark.reporting.tables import format_table

# 8 Draw, video
from lanes.canvas import LEFT_COLOUR, RIGHT_COLOUR
from classic.overlay import (
    draw_lane_between,
    draw_pixels,
    draw_windows,
    draw_fit,
    annotate_image,
    describe_result,
    diagnose,
    follow_lane,
)
from lanes import process_video, read_video
from lanes.files import read_telemetry

# 9 Metres
from lanes.detect.birdseye import BirdsEyeView
from course.plots import show_birdseye

# 10 Paint
from lanes.detect.paint import marking_response, find_stripes

# 11 One model
from lanes import find_lane, draw_lane

# 12 Memory
from lanes.detect.confidence import CONFIDENCE, FEATURES, lane_features, rate_lane
from lanes import LaneTracker
from lanes.draw import track_lane
from course.odometry import integrate_path

# 13 Explain
from lanes import explain
from lanes.figures import show_explanation

# 14 How wrong
from benchmark.evaluation import score_video
from benchmark.consistency import consistency_table
from benchmark.reporting.tables import results_table

# 15 Own finder
from course.own_finder import score_finder, finder_table

# 16 Learn
from lanes.detect.network import network_strength
from lanes.detect.paint import strength_weight

# Sliders
from course.sliders import tune_threshold

# Figures
from course.plots import show_pictures, plot_bars, plot_histogram, plot_series, plot_telemetry, plot_path
