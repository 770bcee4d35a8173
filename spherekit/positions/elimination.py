"""All closed configurations of groups of R pairs with up to three loops, by elimination.

Bars are taken out, one for each loop, until what is left is a tree; the arc of each bar is
one equation, linear in the cosine and sine of each angle of the tree
(`spherekit.geometry.trigonometric_system`). A bar is a body with two R pairs; with its
neighbours placed, its arc between them is the only condition, and it follows from its axes.
No structure is known by name: what matters is which bars there are.

The binary links of a group as arcs between two other bodies, and how they are placed.

A body with two R pairs keeps one axis of each of its neighbours at a fixed arc. With the
neighbours placed, that arc is the only condition, and the body follows from its axes.

Searching the configurations of a mechanism over the range of its inputs at random.

With one input the input is unknown too: a start goes to the configuration curves, so that
one that is short along the input is met as well as others, and not only where an input
probed happens to lie in it. With several each start has the inputs of one sample. Where
wheels are in mesh, each start has an input and the lengths rolled that belong to it.
"""

import numpy as np

_TURN = np.zeros((3, 3, 3))
_TURN[0, 2, 2] = _TURN[1, 0, 0] = _TURN[1, 1, 1] = _TURN[2, 1, 0] = 1.0
_TURN[2, 0, 1] = -1.0
"""A rotation about z is this (3, 3, 3) times its point (1, cos, sin)."""
