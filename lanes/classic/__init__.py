"""The classic pipeline: threshold, warp, sliding windows, polynomial fit, measures, memory."""
