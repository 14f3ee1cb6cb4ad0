"""One image: from the bird's-eye view to the lane.

In: an RGB image and a camera with a pose. Out: a `Lane` with uncertainty and
confidence, or None.
"""
