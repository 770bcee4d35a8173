"""Numerical methods that know nothing of mechanisms: zeros, minima, interpolants."""
