"""Mechanisms for other programs: source code, LaTeX, MJCF, URDF, coupling tables."""
