"""What follows from the graph: freedoms, groups, the sequence of poles."""
