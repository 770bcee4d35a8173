"""Mechanisms for other programs, and from them."""
