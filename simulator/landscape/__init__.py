"""Sky, plants and distant landscape."""
