"""Generalised forces of the loads on a mechanism, load by load, at rows of a motion."""


# What links need and what loads give: wrenches (6,), a moment about the centre O (N m) and
# then a force (N), in ground axes.
