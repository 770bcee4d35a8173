"""Plots that every recording of a motion has, whatever the analyses.

The moving links are in `spherekit.scenes.link_scenes`.
"""

from spherekit.positions.motion import Motion
from spherekit.scenes.scene import Series


def motion_plots(motion: Motion, is_over_time: bool) -> list[list[Series]]:
    """Return the plots of a block of samples, which a recording shows beside the links.

    A block is a group of successive samples. If the samples are times, the plots show the
    pair variables (joint angles) over time. There are no plots if the samples are values of
    the inputs.

    Parameters
    ----------
    motion
        The motion of the block of samples.
    is_over_time
        Whether the samples are times.

    Returns
    -------
    One list for each assembly mode (way to assemble the mechanism), empty if the samples
    are not times.
    """
    plots_by_mode = []
    for position in range(len(motion.assembly_modes)):
        # A motion has all samples of the first mode, then all of the second, and so on.
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
            values=values,
            unit="rad",
        )
        for name, values in variables
    ]
