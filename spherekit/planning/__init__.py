"""Results from the graph of links and pairs: mobility, groups, and the plan of poles."""
