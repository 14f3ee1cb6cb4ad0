"""Robot logs: ROS bags and MCAP files are read like videos, lanes are written as messages.

In: a log, or the lanes of a drive. Out: images with times, a calibration, or an MCAP file with lane messages.
"""
