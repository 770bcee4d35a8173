"""Functions for users of Python that no other layer has."""
