"""
Where the pole axes of a four-bar go
====================================

Paths of the two secondary pole axes on the sphere over one turn of the crank.
"""

import spherekit as sk

result = sk.run("four_bar", "poles")
result.plot("paths of the axes")
