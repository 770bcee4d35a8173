"""The motion of a batch as loads see it, for the analyses of forces."""

from dataclasses import replace

from spherekit.plugin import Batch
from spherekit.plugin.motion import Motion


def as_loads_see(batch: Batch) -> Motion:
    """Return the configurations of a batch with the angles of its loads going on.

    The batch needs the tracer, and continued values of the pairs that loads depend on.
    """
    values = batch.motion.values.copy()
    for pair in batch.needs.continued_values:
        values[:, batch.mechanism.angles[pair]] = batch.continued_value(pair)
    return replace(batch.motion, values=values)
