"""Singular configurations: where inputs and outputs of a mechanism stand still."""
