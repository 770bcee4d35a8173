"""Functions for analyses of motion: position analysis, curves and plans of poles."""

from spherekit.planning.plan_text import describe
from spherekit.planning.pole_plan import BlockPoles, LinePole, Plan, PrimaryPole
from spherekit.positions.configuration_space import configuration_curves
from spherekit.positions.motion import Motion
from spherekit.positions.position_analysis import PositionAnalysis

__all__ = [
    "BlockPoles",
    "LinePole",
    "Motion",
    "Plan",
    "PositionAnalysis",
    "PrimaryPole",
    "configuration_curves",
    "describe",
]
