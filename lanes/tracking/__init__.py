"""The lane tracker in metres; the files in the order of the data flow.

One picture: birdseye, markings, model, residuals, voting, fitting, lane, marking_profile, lines, detector.
A drive: car, process_noise, state, update, marking_type, track, tracked_lane, tracker.
Derived from the result: departure, confidence, odometry, overlay.
"""
