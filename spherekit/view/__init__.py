"""Recordings for the rerun viewer, and pictures of them; only here is it known."""
