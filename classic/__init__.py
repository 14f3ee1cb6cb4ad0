"""The classic pipeline that the course builds: threshold, warp, search, fit, remember, draw."""
