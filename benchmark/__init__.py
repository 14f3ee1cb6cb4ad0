"""Every lane finder scored against ground truth and labels, and its speed."""
