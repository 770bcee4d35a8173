"""
Dead centres of a Stephenson mechanism
======================================

Driven in its four-bar, the output link turns back twice in each mode.
"""

import spherekit as sk

result = sk.run("stephenson", "singularities", samples=181)
result.plot("output 6/1 against the input")
