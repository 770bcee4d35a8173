"""Rotations of an output link about a fixed axis, and motions planned along them."""
