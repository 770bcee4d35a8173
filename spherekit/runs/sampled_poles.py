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

STAND_IN_RELATIVE_STEP = 2.0**-30
"""Relative difference of the numbers of successive poles that stand in for others.

Parquet stores equal numbers once, but those of different poles are not equal. Larger:
numbers have another size after thousands of poles. Smaller: they become equal by rounding.
"""


def evaluate_sample(motion: Motion, wanted: Request, most: int) -> PoleField:
    """Return the poles at a motion, of which many only have the numbers of others.

    The size of tables is measured with them, in little time. The axes of pairs are all
    evaluated, since their numbers are shorter. Of the other poles `most` are evaluated,
    spread evenly over all. Poles with great circles are added if they are no more than
    `most`. Each remaining pole gets the numbers of one of these in turn, except for the
    last digits. Such numbers show how many bytes they take, and nothing else.

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
    pair_poles = axis_pairs(wanted.plan)
    other_poles = [
        pole for pole in wanted.poles if wanted.plan.pole(*pole) not in pair_poles
    ]
    step = max(1, -(-len(other_poles) // most))  # rounded up
    sample = other_poles[::step]
    if len(wanted.planes) <= most:
        sample += [pole for pole in other_poles if pole in wanted.planes.difference(sample)]
    left_out = set(other_poles).difference(sample)
    evaluated_request = replace(
        wanted,
        poles=tuple(pole for pole in wanted.poles if pole not in left_out),
        planes=wanted.planes.difference(left_out),
    )
    field = evaluate(motion, evaluated_request)
    stand_ins: dict[Pole, Pole] = {
        pole: sample[k % len(sample)] for k, pole in enumerate(sorted(left_out))
    }
    for item in fields(PoleField):
        values_by_pole = getattr(field, item.name)
        # `w` and `dw` are the rates of links.
        if not isinstance(values_by_pole, dict) or item.name in ("w", "dw"):
            continue
        for number, (pole, stand_in) in enumerate(stand_ins.items(), start=1):
            if stand_in not in values_by_pole:
                continue
            values = values_by_pole[stand_in]
            if np.issubdtype(values.dtype, np.floating):
                values = values * (1.0 + number * STAND_IN_RELATIVE_STEP)
            values_by_pole[pole] = values
    return field
