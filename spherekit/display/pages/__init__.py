"""A mechanism as one page that any browser opens and moves, without a network."""
