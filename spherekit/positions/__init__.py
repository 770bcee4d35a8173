"""Configurations of a mechanism: assembly modes, their curves, and its motion."""
