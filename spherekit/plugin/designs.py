"""For analyses with figures of merit that compare designs."""

from typing import TYPE_CHECKING

from spherekit.lazy_imports import offered as _offered
from spherekit.plugin import _offer

if TYPE_CHECKING:
    from spherekit.analysis.contract import REDUCTIONS as REDUCTIONS
    from spherekit.analysis.contract import FigureOfMerit as FigureOfMerit
    from spherekit.design.sensitivity import Distribution as Distribution
    from spherekit.design.sensitivity import Sensitivity as Sensitivity
    from spherekit.design.sensitivity import SizeDeviations as SizeDeviations
    from spherekit.engine.row_quantities import middle_pairs as middle_pairs
    from spherekit.engine.row_quantities import row_quantities as row_quantities

__all__, __getattr__, __dir__ = _offered(__name__, __file__, _offer)
