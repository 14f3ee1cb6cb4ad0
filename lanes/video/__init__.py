"""Video files and robot logs: read, write, process frame by frame. Here are the limits that hold for both."""

from fractions import Fraction

# Frame rates that a 32-bit clock and the tracker can handle.
MIN_FPS, MAX_FPS = Fraction(1, 10), 1000
# A larger step back in time is a recorder's restarted clock, as in concatenated clips.
CLOCK_RESET_S = 0.25
# The rate varies if more than this share of the frames follow sooner than this, in frames of a constant rate.
MIN_STEP, MAX_SHORT_SHARE = 0.75, 0.1
