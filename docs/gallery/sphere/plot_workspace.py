"""
The workspace of a wrist
========================

The coloured region has all directions of the pointer that are at least 15 degrees away from
singularities, in one working mode.
"""

import spherekit as sk

result = sk.run("five_bar", "workspace:near=15,working_mode=+-")
result.plot("workspace on the sphere")
