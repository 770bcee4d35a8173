"""
Equivalent inertia
==================

The equivalent inertia is the moment of inertia of all links that the crank feels.
"""

import spherekit as sk

result = sk.run("four_bar", "eksergian")
result.plot("equivalent inertia")
