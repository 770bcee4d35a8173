"""Geometry on the unit sphere: rotations, curves, and regions of directions."""
