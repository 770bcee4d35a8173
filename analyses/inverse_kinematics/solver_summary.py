"""Summary values and texts that inverse and forward kinematics share."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from spherekit.plugin.workspace import ClosedKinematics, OutputKinematics


def summarize_solver(solver: OutputKinematics) -> dict[str, Any]:
    """Return how an output is solved, for the summary."""
    return {
        "output": solver.output.name,
        "closed_form": isinstance(solver, ClosedKinematics),
        "solved_by": solver.solved_by,
        "legs": list(solver.legs),
    }


def describe_omitted_solutions(solver: OutputKinematics) -> list[str]:
    """Return a sentence on configurations that the method leaves out, if there are any."""
    if solver.solved_by != "mid-plane":
        return []
    return [
        "Only configurations in which the output is a mirror image of the base were "
        "computed (closed form); graph=true searches for others, too."
    ]


def count_values(numbers: NDArray[np.int64]) -> dict[str, int]:
    """Return how often each number occurs in an array (n,), by its text for JSON."""
    distinct, counts = np.unique(numbers, return_counts=True)
    return {
        str(number): count
        for number, count in zip(distinct.tolist(), counts.tolist(), strict=True)
    }


def format_degrees(angle: float) -> str:
    """Return an angle (rad) in degrees as text; an angle of zero up to rounding as 0."""
    # Adding zero turns a negative zero into zero.
    return f"{round(np.degrees(angle), 9) + 0.0:.6g}"
