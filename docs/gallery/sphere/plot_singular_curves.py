"""
Singular curves of a wrist
==========================

Where locked cranks do not hold the pointer (type II), and where it cannot go on (type
I), as directions of the pointer in its first assembly mode. The second mode has a figure of
its own.
"""

import spherekit as sk

result = sk.run("five_bar", "singularities:slices=4", samples=(3, 3))
result.plot("on the sphere, mode 0 (+)")

# %%
# The same curves over the two inputs.

result.plot("singular curves of pointer in the inputs")
