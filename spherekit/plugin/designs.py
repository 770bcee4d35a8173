"""For analyses with figures of merit that compare designs."""

from typing import TYPE_CHECKING

from spherekit.lazy_imports import offered as _offered
from spherekit.plugin import _offer

if TYPE_CHECKING:
    from spherekit.designs.sensitivity import Distribution as Distribution
    from spherekit.designs.sensitivity import Sensitivity as Sensitivity
    from spherekit.designs.sensitivity import SizeDeviations as SizeDeviations
    from spherekit.runs.figure_of_merit import REDUCTIONS as REDUCTIONS
    from spherekit.runs.figure_of_merit import FigureOfMerit as FigureOfMerit
    from spherekit.velocities.row_quantities import middle_pairs as middle_pairs
    from spherekit.velocities.row_quantities import row_quantities as row_quantities

__all__, __getattr__, __dir__ = _offered(__name__, __file__, _offer)
