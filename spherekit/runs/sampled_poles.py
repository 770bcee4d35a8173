"""Poles of which some are evaluated, to measure how large tables become.

Tables of all poles of a long chain have thousands of rows at each configuration. The text
of each row takes about as many bytes as that of another one, so a few poles show the size.
"""

from dataclasses import fields, replace

import numpy as np

from spherekit.planning.pole_plan import Pole
from spherekit.positions.motion import Motion
from spherekit.velocities.pole_evaluation import evaluate
from spherekit.velocities.pole_field import PoleField, axis_pairs
from spherekit.velocities.pole_request import Request

RELATIVE_STEP = 2.0**-30
"""Relative difference of the numbers of successive poles that stand in for others. Parquet
stores equal numbers once, and those of different poles are not equal. Larger: numbers are
of another size after thousands of poles; smaller: they become equal by rounding."""


def evaluate_sample(motion: Motion, wanted: Request, most: int) -> PoleField:
    """Return a field in which many poles have the numbers of others.

    The axes of pairs are all evaluated, since their numbers are shorter. Of the other poles
    `most` are evaluated, evenly from all, and those with great circles if they are no more.
    Each further pole gets the numbers of one of these in turn, but for their last digits.
    Such numbers say how much room they take, and nothing else.

    Parameters
    ----------
    motion
        Configurations.
    wanted
        The poles that tables have rows of.
    most
        How many of the poles that are no axes of pairs are evaluated.

    Returns
    -------
    PoleField
        With entries for all poles of the request.
    """
    pairs = axis_pairs(wanted.plan)
    across = [pole for pole in wanted.poles if wanted.plan.pole(*pole) not in pairs]
    step = max(1, -(-len(across) // most))
    sample = across[::step]
    if len(wanted.planes) <= most:
        sample += [pole for pole in across if pole in wanted.planes.difference(sample)]
    left_out = set(across).difference(sample)
    poles = tuple(pole for pole in wanted.poles if pole not in left_out)
    planes = wanted.planes.difference(left_out)
    field = evaluate(motion, replace(wanted, poles=poles, planes=planes))
    stand_in: dict[Pole, Pole] = {
        pole: sample[k % len(sample)] for k, pole in enumerate(sorted(left_out))
    }
    for name in (item.name for item in fields(PoleField)):
        by_pole = getattr(field, name)
        if not isinstance(by_pole, dict) or name in ("w", "dw"):
            continue
        for number, (pole, other) in enumerate(stand_in.items(), start=1):
            if other in by_pole:
                by_pole[pole] = by_pole[other]
                if np.issubdtype(by_pole[other].dtype, np.floating):
                    by_pole[pole] = by_pole[other] * (1.0 + number * RELATIVE_STEP)
    return field
