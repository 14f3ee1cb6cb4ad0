"""One picture explained step by step."""
