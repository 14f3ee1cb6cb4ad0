"""The lane tracker in metres; the files in the order of the data flow.

One picture: birdseye, markings, model, residuals, voting, fitting, marking_type, lane, detector.
A drive: state, update, tracker.
Derived from the result: departure, confidence, odometry, overlay.
"""
