"""Images and videos, in and out.

In: files of any kind that people record, robot logs among them. Out: frames with times,
in RGB and upright; videos with sound. Nothing is detected here.
"""
