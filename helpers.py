"""Advanced Lane Finding, chapter by chapter: every name that project.ipynb uses.

Each function is documented in the module that it is imported from (`help(helpers.undistort)`); this file defines
nothing and lists each name once.
"""

# Data
from course.dataset import open_dataset
from benchmark.scored_drive import PROJECT_ROOT
from course.measures import check, check_error
from course.exercises.check import check_exercise

# 1 Why
from lanes.images import read_image, write_image

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

# 5 Thresholds
from classic.recipe import RECIPES, get_recipe
from classic.finder import LaneFinder
from course.measures import marking_precision, marking_recall
from lanes.describe import format_table
from course.sliders import tune_threshold

# 6 Find
from classic.search import find_peaks, sliding_windows, search_band
from classic.overlay import draw_pixels, draw_windows

# 7 Fit, measure
from classic.fit import fit_line, ransac_line
from lanes.describe import describe_bend, describe_offset
from course.accuracy import accuracy_table
from course.measures import worst_lateral_error_m

# 8 Draw, video
from classic.overlay import annotate_image
from lanes import process_video, read_video
from lanes.files import read_telemetry

# 9 Metres
from lanes.detect.birdseye import BirdsEyeView

# 10 Paint
from lanes.detect.paint import marking_response, find_stripes

# 11 One model
from lanes import find_lane, draw_lane
from course.accuracy import TwoLines

# 12 Memory
from lanes import LaneTracker
from lanes.draw import track_lane

# 13 Explain
from lanes import explain

# 14 How wrong
from benchmark.evaluation import score_video
from benchmark.reporting.tables import results_table

# 15 Own finder
from course.own_finder import score_finder

# Figures
from course.plots import show_pictures, show_birdseye, plot_bars, plot_series
