"""
Where the pole axes of a four-bar go
====================================

The curves are the paths of the two secondary pole axes on the sphere during one turn of the
crank.
"""

import spherekit as sk

result = sk.run("four_bar", "poles")
result.plot("paths of the axes")
