"""Pole axes, velocity coefficients and their derivatives."""
