"""Kinematics of output links: inverse, forward, workspaces, fixed-axis rotations."""
