"""
Dead centres of a four-bar
==========================

The figure shows the output against the input in both assembly modes. The rocker turns back
at singularities of type I.
"""

import spherekit as sk

result = sk.run("four_bar", "singularities")
result.plot("output 4/1 against the input")
