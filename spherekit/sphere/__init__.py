"""Geometry on the sphere, on arrays; knows nothing of mechanisms."""
