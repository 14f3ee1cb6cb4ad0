"""One drive in memory: the lane from frame to frame.

In: frames in order. Out: for each frame the tracked `Lane`, or None; departures of the
car from it.
"""
