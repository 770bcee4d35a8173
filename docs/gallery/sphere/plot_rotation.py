"""
A rotation about a fixed axis
=============================

From one direction to another in a mid-plane symmetric architecture.
"""

import spherekit as sk

result = sk.run(
    "two_dof_spm",
    "equivalent_rotation:start=phi=75+gamma=-20,end=phi=70+gamma=20",
    samples=31,
)
result.plot("equivalent rotation on the sphere")

# %%
# What the inputs do in time.

result.plot("driving angles")
