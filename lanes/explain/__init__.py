"""One picture explained: every step to its lane judged, worded and drawn, and what to do where one failed."""
