"""
Dead centres of a four-bar
==========================

Output against input in both modes; the rocker turns back at type I singularities.
"""

import spherekit as sk

result = sk.run("four_bar", "singularities")
result.plot("output 4/1 against the input")
