"""Kinematics and dynamics as expressions, compiled or run on arrays."""
