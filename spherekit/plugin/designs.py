"""Functions for analyses whose figures of merit compare designs."""

from spherekit.designs.sensitivity import Sensitivity
from spherekit.designs.size_deviations import Distribution, SizeDeviations
from spherekit.runs.figure_of_merit import FigureOfMerit
from spherekit.runs.reductions import REDUCTIONS
from spherekit.velocities.row_quantities import middle_pairs, row_quantities

__all__ = [
    "REDUCTIONS",
    "Distribution",
    "FigureOfMerit",
    "Sensitivity",
    "SizeDeviations",
    "middle_pairs",
    "row_quantities",
]
