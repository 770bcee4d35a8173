"""
A cam
=====

The figures show the velocity and acceleration coefficients of the follower of a cam. They
are computed from the curvature of the profile.
"""

import spherekit as sk

result = sk.run("shaped_cam", "poles", samples=181)
result.plot("velocity coefficients")
