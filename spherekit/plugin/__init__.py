"""What a plugin is written with: contract, tables, scenes, poles by name, errors.

`AbstractAnalysis`, `Needs`, `Batch`, `Findings`, `Sweep`; `conformance`, which checks an
analysis; declared tables; what is to be seen. What analyses of one topic compute with is
in `spherekit.plugin.dynamics`, `motion`, `rotations`, `singularities` and `workspace`.
Names are imported when they are first read.
"""

from typing import TYPE_CHECKING
from typing import Any as _Any

from spherekit.lazy_imports import offered as _offered

if TYPE_CHECKING:
    from spherekit.arrays import Floats as Floats
    from spherekit.errors import AnalysisError as AnalysisError
    from spherekit.errors import ModelError as ModelError
    from spherekit.errors import SolveError as SolveError
    from spherekit.mechanism.elements import Output as Output
    from spherekit.mechanism.mechanism import Mechanism as Mechanism
    from spherekit.planning.pole_plan import Pole as Pole
    from spherekit.planning.pole_plan import all_poles as all_poles
    from spherekit.planning.pole_plan import parse_pole as parse_pole
    from spherekit.planning.pole_plan import pole_of as pole_of
    from spherekit.plugin.checks import conformance as conformance
    from spherekit.runs.batch import Batch as Batch
    from spherekit.runs.contract import AbstractAnalysis as AbstractAnalysis
    from spherekit.runs.contract import Findings as Findings
    from spherekit.runs.contract import Sweep as Sweep
    from spherekit.runs.needs import Needs as Needs
    from spherekit.runs.registry import registered as registered
    from spherekit.scenes.link_scenes import link_bodies as link_bodies
    from spherekit.scenes.scene import Arrow as Arrow
    from spherekit.scenes.scene import Axis as Axis
    from spherekit.scenes.scene import Body as Body
    from spherekit.scenes.scene import Diagram as Diagram
    from spherekit.scenes.scene import Graph as Graph
    from spherekit.scenes.scene import GreatCircle as GreatCircle
    from spherekit.scenes.scene import InputMarks as InputMarks
    from spherekit.scenes.scene import Mark as Mark
    from spherekit.scenes.scene import PlaneCurve as PlaneCurve
    from spherekit.scenes.scene import Portrait as Portrait
    from spherekit.scenes.scene import Primitive as Primitive
    from spherekit.scenes.scene import Scene as Scene
    from spherekit.scenes.scene import Series as Series
    from spherekit.scenes.scene import SphereCurves as SphereCurves
    from spherekit.scenes.scene import SphereMap as SphereMap
    from spherekit.scenes.scene import Surface as Surface
    from spherekit.scenes.scene import Text as Text
    from spherekit.scenes.scene import Trace as Trace
    from spherekit.status import Status as Status
    from spherekit.tables.table import ASSEMBLY_MODE as ASSEMBLY_MODE
    from spherekit.tables.table import INPUT as INPUT
    from spherekit.tables.table import INPUTS as INPUTS
    from spherekit.tables.table import RESIDUAL as RESIDUAL
    from spherekit.tables.table import SAMPLE as SAMPLE
    from spherekit.tables.table import STATUS as STATUS
    from spherekit.tables.table import TIME as TIME
    from spherekit.tables.table import Column as Column
    from spherekit.tables.table import Table as Table
    from spherekit.tables.table import TableData as TableData
    from spherekit.tables.table import input_columns as input_columns
    from spherekit.wording import counted as counted
    from spherekit.wording import listing as listing
    from spherekit.wording import nearest as nearest
    from spherekit.wording import numbered as numbered


def _offer(value: _Any, package: str) -> _Any:
    """Return something of ours as one that judges what it is called with."""
    from spherekit.api_validation import offer

    return offer(value, package)


__all__, __getattr__, __dir__ = _offered(__name__, __file__, _offer)
