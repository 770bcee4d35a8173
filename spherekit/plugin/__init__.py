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
    from spherekit.analysis.batch import Batch as Batch
    from spherekit.analysis.batch import Needs as Needs
    from spherekit.analysis.contract import AbstractAnalysis as AbstractAnalysis
    from spherekit.analysis.contract import Findings as Findings
    from spherekit.analysis.contract import Sweep as Sweep
    from spherekit.analysis.link_scenes import link_bodies as link_bodies
    from spherekit.analysis.registry import registered as registered
    from spherekit.analysis.scene import Arrow as Arrow
    from spherekit.analysis.scene import Axis as Axis
    from spherekit.analysis.scene import Body as Body
    from spherekit.analysis.scene import Diagram as Diagram
    from spherekit.analysis.scene import Graph as Graph
    from spherekit.analysis.scene import GreatCircle as GreatCircle
    from spherekit.analysis.scene import InputMarks as InputMarks
    from spherekit.analysis.scene import Mark as Mark
    from spherekit.analysis.scene import PlaneCurve as PlaneCurve
    from spherekit.analysis.scene import Portrait as Portrait
    from spherekit.analysis.scene import Primitive as Primitive
    from spherekit.analysis.scene import Scene as Scene
    from spherekit.analysis.scene import Series as Series
    from spherekit.analysis.scene import SphereCurves as SphereCurves
    from spherekit.analysis.scene import SphereMap as SphereMap
    from spherekit.analysis.scene import Surface as Surface
    from spherekit.analysis.scene import Text as Text
    from spherekit.analysis.scene import Trace as Trace
    from spherekit.analysis.tables import ASSEMBLY_MODE as ASSEMBLY_MODE
    from spherekit.analysis.tables import INPUT as INPUT
    from spherekit.analysis.tables import INPUTS as INPUTS
    from spherekit.analysis.tables import RESIDUAL as RESIDUAL
    from spherekit.analysis.tables import SAMPLE as SAMPLE
    from spherekit.analysis.tables import STATUS as STATUS
    from spherekit.analysis.tables import TIME as TIME
    from spherekit.analysis.tables import Column as Column
    from spherekit.analysis.tables import Table as Table
    from spherekit.analysis.tables import TableData as TableData
    from spherekit.analysis.tables import input_columns as input_columns
    from spherekit.arrays import Floats as Floats
    from spherekit.conformance import conformance as conformance
    from spherekit.conventions import Status as Status
    from spherekit.conventions import counted as counted
    from spherekit.conventions import listing as listing
    from spherekit.conventions import nearest as nearest
    from spherekit.conventions import numbered as numbered
    from spherekit.errors import AnalysisError as AnalysisError
    from spherekit.errors import ModelError as ModelError
    from spherekit.errors import SolveError as SolveError
    from spherekit.model.mechanism import Mechanism as Mechanism
    from spherekit.model.parts import Output as Output
    from spherekit.planning.poles import Pole as Pole
    from spherekit.planning.poles import all_poles as all_poles
    from spherekit.planning.poles import parse_pole as parse_pole
    from spherekit.planning.poles import pole_of as pole_of


def _offer(value: _Any, package: str) -> _Any:
    """Return something of ours as one that judges what it is called with."""
    from spherekit.api_validation import offer

    return offer(value, package)


__all__, __getattr__, __dir__ = _offered(__name__, __file__, _offer)
