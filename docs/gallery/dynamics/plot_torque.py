"""
The torque that a motion needs
==============================

The crank of the published four-bar makes one turn at 1 rad/s. The figure shows its driving
torque in both assembly modes.
"""

import spherekit as sk

result = sk.run("four_bar", "eksergian")
result.plot("driving torque")
