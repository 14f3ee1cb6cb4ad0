"""What people look at: lanes drawn on images, figures, explanations and the report.

In: images and results. Out: images, matplotlib figures, HTML pages; nothing is detected
here a second time.
"""
