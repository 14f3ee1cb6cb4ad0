"""What the notebook needs besides the classic pipeline: data, checks against the truth,
exercises and figures.
"""

from benchmark.evaluation import PROJECT_ROOT as PROJECT_ROOT
from benchmark.evaluation import score_video as score_video
from benchmark.tables import results_table as results_table
from course.dataset import open_dataset as open_dataset
from course.engine_plots import plot_accuracy as plot_accuracy
from course.engine_plots import plot_ellipse as plot_ellipse
from course.engine_plots import plot_filtered as plot_filtered
from course.engine_plots import plot_gaussian as plot_gaussian
from course.engine_plots import plot_votes as plot_votes
from course.exercises.check import check_exercise as check_exercise
from course.measures import TwoLines as TwoLines
from course.measures import accuracy_table as accuracy_table
from course.measures import check as check
from course.measures import check_error as check_error
from course.measures import lane_widths_px as lane_widths_px
from course.measures import score_finders as score_finders
from course.plots import draw_directions as draw_directions
from course.plots import plot_bars as plot_bars
from course.plots import plot_series as plot_series
from course.plots import road_axes as road_axes
from course.plots import show_birdseye as show_birdseye
from course.plots import show_pictures as show_pictures
from course.plots import show_progress as show_progress
from course.plots import show_table as show_table
from course.search_plots import plot_histogram as plot_histogram
from course.search_plots import show_search as show_search
from course.sliders import tune_threshold as tune_threshold
from course.videos import show_video as show_video
from lanes.describe import format_table as format_table
from lanes.files import read_telemetry as read_telemetry
