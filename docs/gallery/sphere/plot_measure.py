"""
How well a wrist holds its pointer
==================================

The colour is the angle to the nearest singularity, for all directions of the pointer in one
working mode.
"""

import spherekit as sk

result = sk.run(
    "five_bar",
    "inverse_kinematics:window=azimuth:-180:180:61+tilt:1:179:31,working_mode=+-",
)
result.plot("measure on the sphere")
