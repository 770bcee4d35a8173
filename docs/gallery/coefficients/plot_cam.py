"""
A cam
=====

The pole of cam and follower lies on the contact plane; coefficients follow from the
curvature of the profile.
"""

import spherekit as sk

result = sk.run("shaped_cam", "poles", samples=181)
result.plot("velocity coefficients")
