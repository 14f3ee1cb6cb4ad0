"""One picture: from the bird's-eye view to the lane."""
