"""
Velocity coefficients of a four-bar
===================================

How fast every link turns relative to every other one, for each turn of the crank, in
both assembly modes.
"""

import spherekit as sk

result = sk.run("four_bar", "poles")
result.plot("velocity coefficients")
