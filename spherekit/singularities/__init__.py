"""Singular configurations: points, curves, surfaces, and what they divide."""
