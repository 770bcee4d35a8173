"""Poles of which some are evaluated, to measure how large tables become.

Tables of all poles of a long chain have thousands of rows at each configuration. The texts
of all rows take about equally many bytes, so a few poles show the size.
"""

from dataclasses import fields, replace

import numpy as np

from spherekit.planning.pole_plan import Pole
from spherekit.positions.motion import Motion
from spherekit.velocities.pole_evaluation import evaluate
from spherekit.velocities.pole_field import PoleField, axis_pairs
from spherekit.velocities.pole_request import Request

STAND_IN_RELATIVE_STEP = 2.0**-30
"""Relative difference between the values of successive poles with substituted values.

Parquet stores equal numbers once, but the true values of different poles are not equal.
Larger: numbers have another size after thousands of poles. Smaller: they become equal by
rounding.
"""


def evaluate_sample(motion: Motion, request: Request, max_poles: int) -> PoleField:
    """Evaluate some of the requested poles, and give the other poles similar values.

    The result serves to predict the size of tables with many poles in little time. A pole
    that is not evaluated gets the values of an evaluated pole with other last digits. These
    values take as many bytes as right values, but are meaningless.

    A pole is the axis about which one link rotates relative to another. All poles that are
    the axis of a pair (joint) are evaluated. The values of these poles have fewer digits
    and so take fewer bytes. About `max_poles` of all other poles are evaluated.

    Parameters
    ----------
    motion
        Configurations.
    request
        The poles of the tables.
    max_poles
        Largest number of evaluated poles. They are spread evenly over all poles that are
        not the axis of a pair. Poles with requested great circles are evaluated in
        addition, unless there are more such poles than this number.

    Returns
    -------
    PoleField
        With values for all poles of the request.
    """
    # Poles on pair axes are evaluated in any case. Of all other poles, every `step`-th pole
    # is evaluated.
    pair_poles = axis_pairs(request.plan)
    other_poles = [
        pole for pole in request.poles if request.plan.pole(*pole) not in pair_poles
    ]
    # -(-a // b) is a / b, rounded up.
    step = max(1, -(-len(other_poles) // max_poles))
    evaluated_poles = other_poles[::step]
    if len(request.planes) <= max_poles:
        added_poles = request.planes.difference(evaluated_poles)
        evaluated_poles += [pole for pole in other_poles if pole in added_poles]

    skipped_poles = set(other_poles).difference(evaluated_poles)
    evaluated_request = replace(
        request,
        poles=tuple(pole for pole in request.poles if pole not in skipped_poles),
        planes=request.planes.difference(skipped_poles),
    )
    field = evaluate(motion, evaluated_request)

    # Each skipped pole gets the numbers of an evaluated pole, its stand-in.
    stand_ins: dict[Pole, Pole] = {
        pole: evaluated_poles[k % len(evaluated_poles)]
        for k, pole in enumerate(sorted(skipped_poles))
    }
    for item in fields(PoleField):
        values_by_pole = getattr(field, item.name)
        # The angular velocities `w` and their derivatives `dw` belong to links. All other
        # dictionaries belong to poles and get stand-ins.
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
