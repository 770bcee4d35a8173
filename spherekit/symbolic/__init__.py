"""Expressions as a graph, evaluated by NumPy, in quad precision, or by heyoka."""
