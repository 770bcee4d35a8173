"""
Singular curves of a wrist
==========================

Where locked cranks do not hold the pointer (type II), and where it cannot go on (type
I), over the two inputs.
"""

import spherekit as sk

result = sk.run("five_bar", "singularities:slices=8", samples=(5, 5))
result.plot("singular curves of pointer in the inputs")
