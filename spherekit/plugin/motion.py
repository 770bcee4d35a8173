"""What analyses find configurations with: the tracer, curves, plans of poles."""

from typing import TYPE_CHECKING

from spherekit.lazy_imports import offered as _offered
from spherekit.plugin import _offer

if TYPE_CHECKING:
    from spherekit.planning.plan_text import describe as describe
    from spherekit.planning.pole_plan import BlockPoles as BlockPoles
    from spherekit.planning.pole_plan import LinePole as LinePole
    from spherekit.planning.pole_plan import Plan as Plan
    from spherekit.planning.pole_plan import PrimaryPole as PrimaryPole
    from spherekit.positions.configuration_space import (
        configuration_curves as configuration_curves,
    )
    from spherekit.positions.motion import Motion as Motion
    from spherekit.positions.position_analysis import PositionAnalysis as PositionAnalysis

__all__, __getattr__, __dir__ = _offered(__name__, __file__, _offer)
