"""Recordings for the rerun viewer, and pictures taken of them."""
