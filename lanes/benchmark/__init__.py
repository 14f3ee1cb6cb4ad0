"""How well the lane is found: results against truth, for every system side by side."""
