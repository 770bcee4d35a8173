"""What a plugin is written with: contract, tables, scenes, poles by name, errors.

`AbstractAnalysis`, `Needs`, `Batch`, `Findings`, `Sweep`; `conformance`, which checks an
analysis; declared tables; what is to be seen. What analyses of one topic compute with is
in `spherekit.plugin.dynamics`, `motion`, `rotations`, `singularities` and `workspace`.
Names are imported when they are first read.
"""

from spherekit.arrays import Floats
from spherekit.errors import AnalysisError, ModelError, SolveError
from spherekit.mechanism.elements import Output
from spherekit.mechanism.mechanism import Mechanism
from spherekit.planning.pole_plan import Pole, all_poles, parse_pole, pole_of
from spherekit.plugin.checks import conformance
from spherekit.runs.batch import Batch
from spherekit.runs.contract import AbstractAnalysis, Findings, Sweep
from spherekit.runs.needs import Needs
from spherekit.runs.registry import registered
from spherekit.scenes.link_scenes import link_bodies
from spherekit.scenes.scene import (
    Arrow,
    Axis,
    Body,
    Diagram,
    Graph,
    GreatCircle,
    InputMarks,
    Mark,
    PlaneCurve,
    Portrait,
    Primitive,
    Scene,
    Series,
    SphereCurves,
    SphereMap,
    Surface,
    Text,
    Trace,
)
from spherekit.status import Status
from spherekit.tables.table import (
    ASSEMBLY_MODE,
    INPUT,
    INPUTS,
    RESIDUAL,
    SAMPLE,
    STATUS,
    TIME,
    Column,
    Table,
    TableData,
    input_columns,
)
from spherekit.wording import counted, listing, nearest, numbered

__all__ = [
    "ASSEMBLY_MODE",
    "INPUT",
    "INPUTS",
    "RESIDUAL",
    "SAMPLE",
    "STATUS",
    "TIME",
    "AbstractAnalysis",
    "AnalysisError",
    "Arrow",
    "Axis",
    "Batch",
    "Body",
    "Column",
    "Diagram",
    "Findings",
    "Floats",
    "Graph",
    "GreatCircle",
    "InputMarks",
    "Mark",
    "Mechanism",
    "ModelError",
    "Needs",
    "Output",
    "PlaneCurve",
    "Pole",
    "Portrait",
    "Primitive",
    "Scene",
    "Series",
    "SolveError",
    "SphereCurves",
    "SphereMap",
    "Status",
    "Surface",
    "Sweep",
    "Table",
    "TableData",
    "Text",
    "Trace",
    "all_poles",
    "conformance",
    "counted",
    "input_columns",
    "link_bodies",
    "listing",
    "nearest",
    "numbered",
    "parse_pole",
    "pole_of",
    "registered",
]
