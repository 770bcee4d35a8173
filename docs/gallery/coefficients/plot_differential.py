"""
A gear differential
===================

With one axle locked the carrier turns half as fast as the other.
"""

import spherekit as sk

result = sk.run("bevel_differential", "poles", samples=37)
result.plot("left_axle moves: velocity coefficients to ground")
