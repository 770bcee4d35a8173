"""Measured speed and accuracy of spherekit: ``python -m benchmarks --help``."""
