"""
A gear differential
===================

If one axle of a bevel gear differential is locked, the carrier turns at half the speed of
the other axle.
"""

import spherekit as sk

result = sk.run("bevel_differential", "poles", samples=37)
result.plot("left_axle moves: velocity coefficients to ground")
