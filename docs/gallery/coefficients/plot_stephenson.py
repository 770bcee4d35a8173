"""
A Stephenson mechanism
======================

This mechanism has six links, fifteen pole axes and four assembly modes. The figures show
the coefficients of the output relative to the frame and to its neighbour.
"""

import spherekit as sk

result = sk.run("stephenson", "poles:only=61+62", samples=181)
result.plot("velocity coefficients")
