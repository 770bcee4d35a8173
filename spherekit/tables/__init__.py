"""Declared tables with units, their rows in memory, and their files."""
