"""Functions of one variable as numbers: interpolants with measured error, and zeros."""
