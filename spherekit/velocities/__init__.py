"""Pole axes, velocity coefficients and their error bounds at many configurations."""
