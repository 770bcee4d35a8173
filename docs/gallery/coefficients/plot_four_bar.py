"""
Velocity coefficients of a four-bar
===================================

The curves show the angular velocity of every link relative to every other one, divided by
that of the crank, in both assembly modes.
"""

import spherekit as sk

result = sk.run("four_bar", "poles")
result.plot("velocity coefficients")
