"""The two-freedom spherical mechanism of Chen et al. 2021 for any arcs."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from spherekit.errors import ModelError
from spherekit.model.geometry import link_axes
from spherekit.model.mechanism import (
    Input,
    LinkSizes,
    Mechanism,
    Output,
    Pair,
    SizeGeometry,
    Source,
)

_PAIRS = (
    ("21", "2", "1"),
    ("32", "2", "3"),
    ("43", "3", "4"),
    ("54", "4", "5"),
    ("65", "5", "6"),
    ("61", "1", "6"),
    ("74", "4", "7"),
    ("87", "7", "8"),
    ("81", "1", "8"),
    ("9_2", "2", "9"),
    ("10_6", "6", "10"),
    ("11_8", "8", "11"),
    ("11_9", "9", "11"),
    ("11_10", "10", "11"),
)


def mid_plane_mechanism(
    alphas: Sequence[float], name: str = "mid_plane_mechanism"
) -> Mechanism:
    """Return the mechanism as its graph of 11 links and 14 pairs.

    Parameters
    ----------
    alphas
        The arcs alpha_1 to alpha_8 (rad) of Fig. 2: of the base, of links 2 and 3, of the
        end effector, of links 5 and 6, of links 7 and 8. The axes OB9 and OB7 of the third
        leg are in the middles of the base and of the end effector.
    name
        Name of the mechanism.

    Raises
    ------
    ModelError
        If there are not eight arcs between 0 and 180 degrees.

    Notes
    -----
    The base and the end effector mirror each other only if alpha_1 = alpha_4,
    alpha_2 = alpha_3, alpha_5 = alpha_6 and alpha_7 = alpha_8. Driving angles are those
    of the paper, 0 where a driven link lies along the base, pointing away from its middle.
    """
    arcs = tuple(float(alpha) for alpha in alphas)
    if len(arcs) != 8 or not all(0.0 < alpha < np.pi for alpha in arcs):
        raise ModelError(
            f"alphas: found {np.round(np.degrees(arcs), 6).tolist()} deg, needs eight arcs "
            "between 0 and 180 deg, alpha_1 to alpha_8"
        )
    a1, a2, a3, a4, a5, a6, a7, a8 = arcs
    right = 0.5 * np.pi
    sizes = {
        "1": LinkSizes(("21", "61", "81"), (a1, 0.5 * a1), (0.0,)),
        "2": LinkSizes(("21", "32", "9_2"), (a2, a2), (0.0,)),
        "3": LinkSizes(("32", "43"), (a3,)),
        "4": LinkSizes(("43", "54", "74"), (a4, 0.5 * a4), (0.0,)),
        "5": LinkSizes(("54", "65"), (a5,)),
        "6": LinkSizes(("61", "65", "10_6"), (a6, a6), (0.0,)),
        "7": LinkSizes(("74", "87"), (a7,)),
        "8": LinkSizes(("81", "87", "11_8"), (a8, a8), (0.0,)),
        "9": LinkSizes(("9_2", "11_9"), (right,)),
        "10": LinkSizes(("10_6", "11_10"), (right,)),
        "11": LinkSizes(("11_8", "11_9", "11_10"), (right, right), (0.0,)),
    }
    pairs = tuple(Pair(pair, "R", (first, second)) for pair, first, second in _PAIRS)
    made = Mechanism(
        name,
        "1",
        tuple(str(number) for number in range(1, 12)),
        pairs,
        SizeGeometry(sizes, {"21": -np.pi, "61": np.pi}),
        inputs=(
            Input("21", np.radians(14.0), np.radians(31.0)),
            Input("61", np.radians(12.0), np.radians(23.0)),
        ),
        source=Source(
            "Z. Chen, X. Chen, M. Gao, C. Zhao, K. Zhao and Y. Li, Motion characteristics "
            "analysis of a novel spherical two-degree-of-freedom parallel mechanism, 2021, "
            "doi 10.21203/rs.3.rs-258461, Figs. 1 and 2"
        ),
    )
    x, y, z = link_axes(made)["4"]["74"].tolist()
    return replace(made, outputs=(Output("pointer", "4", "1", (x, y, z)),))
