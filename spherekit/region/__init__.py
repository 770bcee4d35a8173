"""Regions of directions and of orientations where given margins are not negative."""
