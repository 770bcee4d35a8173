"""What analyses find configurations with: the tracer, curves, plans of poles."""

from typing import TYPE_CHECKING

from spherekit.lazy_imports import offered as _offered
from spherekit.plugin import _offer

if TYPE_CHECKING:
    from spherekit.motion.configuration import configuration_curves as configuration_curves
    from spherekit.motion.motion import Motion as Motion
    from spherekit.motion.motion import PositionAnalysis as PositionAnalysis
    from spherekit.planning.poles import BlockPoles as BlockPoles
    from spherekit.planning.poles import LinePole as LinePole
    from spherekit.planning.poles import Plan as Plan
    from spherekit.planning.poles import PrimaryPole as PrimaryPole
    from spherekit.planning.poles import describe as describe

__all__, __getattr__, __dir__ = _offered(__name__, __file__, _offer)
