"""Plots that every recording of a motion has, whatever the analyses.

The moving links are in `spherekit.scenes.link_scenes`.
"""

import numpy as np

from spherekit.arrays import Floats
from spherekit.positions.motion import Motion
from spherekit.scenes.scene import Series


def motion_plots(motion: Motion, is_over_time: bool) -> list[list[Series]]:
    """Return the plots of a block of samples, one list for each assembly mode.

    Parameters
    ----------
    motion
        The motion of the block.
    is_over_time
        Whether the samples are times. Then the pair variables are plotted.
    """
    plots_by_mode = []
    for position in range(len(motion.assembly_modes)):
        rows = slice(position * motion.samples, (position + 1) * motion.samples)
        plots: list[Series] = []
        if is_over_time:
            plots += _variable_plots(motion, rows)
        plots_by_mode.append(plots)
    return plots_by_mode


def _variable_plots(motion: Motion, rows: slice) -> list[Series]:
    """Return the plots of all pair variables in the rows of one assembly mode."""
    variables = zip(motion.mechanism.variable_names, motion.values[rows].T, strict=True)
    return [
        Series(
            path=f"plots/variable/{name}",
            label=name,
            group="pair variables",
            values=_break_at_jumps(values),
            unit="rad",
        )
        for name, values in variables
    ]


def _break_at_jumps(values: Floats) -> Floats:
    """Return angles (n,) rad, NaN where they jump by about a turn."""
    jumps = np.abs(np.diff(values, prepend=values[:1])) > np.pi
    return np.where(jumps, np.nan, values)
