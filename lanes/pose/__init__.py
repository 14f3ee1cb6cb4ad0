"""Where the camera is: its height and angles above the road, estimated from the lanes
in images.

In: images and the intrinsics. Out: a `PoseEstimate`, with uncertainty, or the change of
a pose within a drive.
"""
