"""Loops and drives of URDF files, in elements that the format itself lacks.

Tree joints cannot close loops. In use are `<loop_joint>` with two links and the places on
them (Drake, Isaac Sim, and exporters that write parent and child with origins), and
`<loop>` with `<predecessor>` and `<successor>` (URDF+, Chignoli et al. 2024).
"""

from xml.etree import ElementTree

import numpy as np

from spherekit.arrays import Floats

Element = ElementTree.Element


TURNING = ("revolute", "continuous")


def _vector(item: Element, key: str) -> Floats:
    return np.array((item.get(key) or "0 0 0").split(), dtype=float)
