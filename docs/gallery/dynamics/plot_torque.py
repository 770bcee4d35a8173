"""
The torque that a motion takes
==============================

The published four-bar through one turn at 1 rad/s: driving torque in both modes.
"""

import spherekit as sk

result = sk.run("four_bar", "eksergian")
result.plot("driving torque")
