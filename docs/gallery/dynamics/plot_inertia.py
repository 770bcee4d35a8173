"""
Equivalent inertia
==================

What the crank feels of the mass of all links.
"""

import spherekit as sk

result = sk.run("four_bar", "eksergian")
result.plot("equivalent inertia")
