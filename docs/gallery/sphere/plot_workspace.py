"""
The workspace of a wrist
========================

Directions at least 15 degrees from any singularity, in one working mode.
"""

import spherekit as sk

result = sk.run("five_bar", "workspace:near=15,working_mode=+-")
result.plot("workspace on the sphere")
