"""What follows from the link/pair graph: mobility, groups, and the plan of poles."""
