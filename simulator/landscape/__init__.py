"""Sky, plants and the distant landscape."""
