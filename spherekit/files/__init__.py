"""Mechanism files: reading, writing, and finding the shipped ones."""
