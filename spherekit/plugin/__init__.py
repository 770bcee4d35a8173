"""The names with which every plugin is written.

These names are the contract of analyses (`AbstractAnalysis`, `Needs`, `Batch`, `Findings`,
`FigureOfMerit`, `ParameterTrade`), declared tables, visible objects, poles by name, and
errors. `conformance` checks an analysis. The functions that analyses of one topic need are
in `spherekit.plugin.designs`, `dynamics`, `motion`, `quantities`, `rotations`,
`singularities` and `workspace`. They load more code, so an analysis imports only the
modules that it uses.
"""

from spherekit.arrays import Floats
from spherekit.errors import AnalysisError, ModelError, SolveError
from spherekit.geometry.rotation import quaternion
from spherekit.mechanism.elements import Output
from spherekit.mechanism.mechanism import Mechanism
from spherekit.mechanism.pair_frames import link_axes
from spherekit.number_text import degree_range_text, degrees_text, number_text
from spherekit.planning.pole_plan import Pole, all_poles, parse_pole, pole_of
from spherekit.plugin.checks import conformance
from spherekit.runs.batch import Batch
from spherekit.runs.contract import AbstractAnalysis, Findings, ParameterTrade
from spherekit.runs.figure_of_merit import FigureOfMerit
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
from spherekit.tables.screen_table import ScreenColumn, ScreenTable
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
    "FigureOfMerit",
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
    "ParameterTrade",
    "PlaneCurve",
    "Pole",
    "Portrait",
    "Primitive",
    "Scene",
    "ScreenColumn",
    "ScreenTable",
    "Series",
    "SolveError",
    "SphereCurves",
    "SphereMap",
    "Status",
    "Surface",
    "Table",
    "TableData",
    "Text",
    "Trace",
    "all_poles",
    "conformance",
    "counted",
    "degree_range_text",
    "degrees_text",
    "input_columns",
    "link_axes",
    "link_bodies",
    "listing",
    "nearest",
    "number_text",
    "numbered",
    "parse_pole",
    "pole_of",
    "quaternion",
    "registered",
]
