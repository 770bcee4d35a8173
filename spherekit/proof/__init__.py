"""Proven statements and reference values, computed with balls that bound their error."""
