"""The API pages: tables of all public names by purpose, and a page for each object."""

import importlib
import inspect
import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from pkgutil import iter_modules
from types import GenericAlias
from typing import Any

from spherekit import plugin
from spherekit.plugin import Column

PLUGIN_TOPICS = tuple(
    name for _, name, _ in iter_modules(plugin.__path__, f"{plugin.__name__}.")
)
"""Modules of `spherekit.plugin`; each has the names for analyses of one topic."""

LONGEST_SHOWN_VALUE = 400
"""Characters up to which the index shows the value of a constant; longer: only its type."""

Purposes = Mapping[str, tuple[str, ...]]
"""Public names of a package by the purpose they serve, in the order of the page."""

USER_PURPOSES: Purposes = {
    "Load and build mechanisms": (
        *("load", "load_study", "mechanisms", "build", "dump", "import_mechanism", "lock"),
        *("mid_plane_form", "Mechanism", "Study"),
    ),
    "Loads": (
        *("Gravity", "Spring", "Damper", "Friction", "PairTorque", "TorqueTable"),
        *("PointForce", "Moment", "Bearings", "ContactFriction"),
    ),
    "Plan the poles": ("plan", "table", "Plan"),
    "Evaluate configurations": (
        *("evaluate", "trace", "exact_rows", "Kinematics", "Motion", "Status", "Digits"),
        *("ForwardKinematics", "InverseKinematics"),
    ),
    "Rotate an output about a fixed axis": ("follow_rotation", "follow_to", "time_optimal"),
    "Run analyses": ("run", "trade", "RunResult", "Setting"),
    "Sweep and synthesize": ("sweep", "synthesize"),
    "Simulate": (
        *("simulate", "inverse_dynamics", "reference_simulation", "Simulation", "Start"),
        *("PoseStart", "ConstantSpeed", "Cycloidal", "Polynomial", "Tabulated"),
        *("reduced_model", "reduced_grid_model", "simulate_reduced"),
    ),
    "Export": ("export", "page", "coupling_table", "load_coupling", "load_reduced"),
    "Errors and version": ("SpherekitError", "__version__"),
}

DISPLAY_PURPOSES: Purposes = {
    "Recordings and pictures (`spherekit.display`)": (
        *("open_viewer", "screenshot", "RerunRecorder", "RecordingHead"),
    ),
}

PLUGIN_PURPOSES: Purposes = {
    "Declare an analysis": (
        *(
            "AbstractAnalysis",
            "Needs",
            "Batch",
            "Findings",
            "FigureOfMerit",
            "ParameterTrade",
        ),
        *("registered", "conformance"),
    ),
    "Declare tables": (
        *("Table", "Column", "TableData", "input_columns", "SAMPLE", "ASSEMBLY_MODE"),
        *("STATUS", "RESIDUAL", "INPUT", "INPUTS", "TIME"),
    ),
    "Print results on the screen": (
        *("ScreenTable", "ScreenColumn"),
        *("number_text", "degrees_text", "degree_range_text"),
    ),
    "Read the mechanism": (
        *("Mechanism", "Output", "Pole", "all_poles", "pole_of", "parse_pole", "link_axes"),
        *("quaternion", "Floats"),
    ),
    "Draw scenes": (
        *("Scene", "Primitive", "Body", "link_bodies", "Arrow", "Trace", "GreatCircle"),
        *("SphereCurves", "SphereMap", "Surface", "Graph", "Mark", "Text", "Axis"),
        *("Series", "InputMarks", "Portrait", "PlaneCurve", "Diagram"),
    ),
    "Report statuses and errors": (
        *("Status", "AnalysisError", "ModelError", "SolveError", "counted", "listing"),
        *("numbered", "nearest"),
    ),
}

USER_INDEX = """\
# Python API

All public names of `spherekit`, by purpose. Import the package with
`import spherekit as sk`. Names that are not listed here or under
[API for plugins](plugin.md) may change without notice.

Angles are in radians unless an argument `angle_unit` says otherwise. Vectors have
components along the axes of the ground link. The samples are the first axis of every
array, except in the result of `evaluate` at one input in one assembly mode.
[From Python](../../python.md) has examples.
The {ref}`index <genindex>` lists all names in alphabetical order.

"""

PLUGIN_INDEX = """\
# API for plugins

Names with which an [analysis of your own](../../plugins.md) is written, by purpose. The
names for users are in the [Python API](index.md).

"""


@dataclass(frozen=True)
class ApiObject:
    """A public name of a package, with its object and the page that describes it.

    Attributes
    ----------
    package
        Name of the package that exports it.
    name
        Name in that package.
    value
        The object.
    page
        Name of its page, without suffix; empty for constants and types, which have none.
    """

    package: str
    name: str
    value: Any
    page: str

    @property
    def is_class(self) -> bool:
        """Whether it is a class, and not a type such as ``list[int]``."""
        return inspect.isclass(self.value) and not isinstance(self.value, GenericAlias)

    @property
    def has_page(self) -> bool:
        """Whether it has a page: classes and functions have one."""
        return self.is_class or inspect.isroutine(self.value)


def pages() -> Iterator[tuple[str, str]]:
    """Yield the two indexes, and a page for each class and function."""
    objects = ApiObjects()
    user_sections = [
        *sections("spherekit", USER_PURPOSES),
        *sections("spherekit.display", DISPLAY_PURPOSES),
    ]
    plugin_sections = [*sections("spherekit.plugin", PLUGIN_PURPOSES)]
    for topic in PLUGIN_TOPICS:
        names = tuple(importlib.import_module(topic).__all__)
        plugin_sections.append((topic, topic_title(topic), names))

    yield "api/index.md", USER_INDEX + objects.index(user_sections)
    yield "api/plugin.md", PLUGIN_INDEX + objects.index(plugin_sections)
    yield from objects.pages()


Section = tuple[str, str, tuple[str, ...]]
"""A section of an index: the package, the heading and the names."""


def sections(package: str, purposes: Purposes) -> Iterator[Section]:
    """Yield a section for each purpose, after checking that no public name is left out.

    Raises
    ------
    ValueError
        A public name of the package has no purpose or two, or a name is not public.
    """
    public = sorted(name for name in importlib.import_module(package).__all__)
    listed = sorted(name for names in purposes.values() for name in names)
    if public != listed:
        missing = sorted({*public} - {*listed})
        unknown = sorted({*listed} - {*public})
        repeated = sorted({name for name in listed if listed.count(name) > 1})
        raise ValueError(
            f"docs/site_pages/api.py: the purposes of {package} must list each of its "
            f"public names once; missing: {missing}, not public: {unknown}, "
            f"more than once: {repeated}"
        )
    for title, names in purposes.items():
        yield package, title, names


def topic_title(topic: str) -> str:
    """Return the heading of a module of the plugin API, from its docstring."""
    module = importlib.import_module(topic)
    summary = (inspect.getdoc(module) or "").partition("\n")[0].rstrip(".")
    return f"{summary} (`{topic}`)"


class ApiObjects:
    """All objects of the API. An object that two packages export has one page."""

    def __init__(self) -> None:
        """Begin with no objects."""
        self._objects_by_id: dict[int, ApiObject] = {}
        self._page_names: set[str] = set()

    def index(self, index_sections: Iterable[Section]) -> str:
        """Return the tables of an index, and the list of the pages that begin in it."""
        lines = []
        new_pages = []
        for package, title, names in index_sections:
            lines += [f"## {title}", "", "| name | description |", "|---|---|"]
            module = importlib.import_module(package)
            for name in names:
                value = getattr(module, name)
                known = self._objects_by_id.get(id(value))
                described = known or self._add(package, name, value)
                lines.append(table_row(name, described))
                if described.has_page and known is None:
                    new_pages.append(f"{name} <{described.page}>")
            lines.append("")
        lines += ["```{toctree}", ":hidden:", "", *new_pages, "```", ""]
        return "\n".join(lines)

    def pages(self) -> Iterator[tuple[str, str]]:
        """Yield the page of every object that is in one of the indexes."""
        for described in self._objects_by_id.values():
            if described.has_page:
                yield f"api/{described.page}.rst", object_page(described)

    def _add(self, package: str, name: str, value: Any) -> ApiObject:
        """Add an object. The names of its page and of others differ not in case alone."""
        page = f"{package}.{name}"
        if page.lower() in self._page_names:  # on some systems these would be one file
            page += "-class" if inspect.isclass(value) else "-function"
        self._page_names.add(page.lower())
        described = ApiObject(package, name, value, page)
        self._objects_by_id[id(value)] = described
        return described


def table_row(name: str, described: ApiObject) -> str:
    """Return the row of an index: the name with its link, and what it is in one line."""
    shown = f"`{name}`"
    if described.has_page:
        shown = f"[{shown}]({described.page}.rst)"
        description = (inspect.getdoc(described.value) or "").partition("\n")[0]
    elif isinstance(described.value, Column):
        description = f"the column `{described.value.name}`: {described.value.meaning}"
    else:
        without_modules = re.sub(r"\b(?:\w+\.)+(?=[A-Za-z_])", "", repr(described.value))
        is_short = len(without_modules) <= LONGEST_SHOWN_VALUE
        description = (
            f"`{without_modules}`" if is_short else f"a `{type(described.value).__name__}`"
        )
    return f"| {shown} | {description.replace('|', chr(92) + '|')} |"


def object_page(described: ApiObject) -> str:
    """Return the page of a class or a function, from its docstring."""
    title = f"{described.package}.{described.name}"
    lines = [title, "=" * len(title), "", f".. currentmodule:: {described.package}", ""]
    if described.is_class:
        lines += [f".. autoclass:: {described.name}"]
        lines += ["   :members:", "   :member-order: bysource"]
    else:
        lines += [f".. autofunction:: {described.name}"]
    return "\n".join([*lines, ""])
