"""One image: from the bird's-eye view to the lane."""
