"""The frozen description of a mechanism and what follows from it alone."""
