"""Robot logs: ROS bags and MCAP files are read like videos.

In: a log. Out: images with times, and messages of a calibration. The messages that are
written are those of `lanes.show.lane_messages`.
"""
