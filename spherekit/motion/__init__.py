"""Configurations of a mechanism over the range of its input."""
