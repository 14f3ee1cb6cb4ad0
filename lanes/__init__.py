"""Camera-based lane finding: one module for each step, in the order in which a frame flows through them."""
