"""What an output reaches under constraints, in each working mode."""
