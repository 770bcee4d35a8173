"""
Singular curves of a wrist
==========================

The curves are the directions of the pointer at which locked cranks do not hold it (type
II), and at which it cannot move on (type I), in the first assembly mode. The second mode
has its own figure.
"""

import spherekit as sk

result = sk.run("five_bar", "singularities:slices=4", samples=(3, 3))
result.plot("on the sphere, mode 0 (+)")

# %%
# The next figure shows the same curves over the two inputs.

result.plot("singular curves of pointer in the inputs")
