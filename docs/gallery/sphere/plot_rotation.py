"""
A rotation about a fixed axis
=============================

A mechanism with a mid-plane symmetric architecture turns its output from one direction to
another one about a fixed axis.
"""

import spherekit as sk

result = sk.run(
    "two_dof_spm",
    "equivalent_rotation:start=phi=75+gamma=-20,end=phi=70+gamma=20",
    samples=31,
)
result.plot("equivalent rotation on the sphere")

# %%
# The next figure shows the inputs as functions of time.

result.plot("driving angles")
