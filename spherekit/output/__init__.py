"""Kinematics of declared outputs: inverse, forward, rates and singularity measures."""
