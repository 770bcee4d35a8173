"""
A Stephenson mechanism
======================

Six links, fifteen pole axes, four assembly modes; here those of the output with the
frame and with its neighbour.
"""

import spherekit as sk

result = sk.run("stephenson", "poles:only=61+62", samples=181)
result.plot("velocity coefficients")
