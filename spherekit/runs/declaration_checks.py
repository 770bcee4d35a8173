"""What a class has to be to be used as an analysis, said before anything is computed.

What an analysis declares to read of a mechanism, checked before it is planned.

`Needs`, tables and columns have judged the types of what they hold.
"""

from collections.abc import Iterator, Sequence
from dataclasses import is_dataclass
from itertools import groupby
from typing import Any, get_args, get_type_hints

import numpy as np

from spherekit.conventions import NAME_PATTERN
from spherekit.errors import PluginError
from spherekit.mechanism.mechanism import Mechanism
from spherekit.runs.analysis_faults import described, faults_of
from spherekit.runs.contract import CONTRACT, AbstractAnalysis, BrokenAnalysis
from spherekit.runs.needs import Needs
from spherekit.runs.parameter_text import parameters
from spherekit.runs.run_result import MOTION
from spherekit.tables.column_units import UNIT_SYMBOLS, is_unit
from spherekit.tables.table import COLUMNS, Table
from spherekit.type_checks import type_fault
from spherekit.wording import choices, listing

TAKEN = (MOTION, COLUMNS.partition(".")[0])
"""What no analysis is called: the stems of files that every run writes."""


def fault_of_class(cls: Any) -> str:
    """Return what keeps a class from being used as an analysis, or nothing."""
    return next(_faults(cls), "")


def _faults(cls: Any) -> Iterator[str]:
    if not (isinstance(cls, type) and issubclass(cls, AbstractAnalysis)):
        yield f"{cls!r} is not a subclass of AbstractAnalysis"
        return
    for key, hint in get_type_hints(AbstractAnalysis).items():
        if not hasattr(cls, key):
            yield f"the class attribute `{key}` is missing"
            return
        if fault := type_fault(key, getattr(cls, key), *get_args(hint)):
            yield f"the class attribute {fault}"
    if not NAME_PATTERN.fullmatch(cls.name):
        yield f"its name {cls.name!r} may hold letters, digits and underscores only"
    if cls.name in TAKEN:
        yield f"its name {cls.name!r} is that of a file that every run writes"
    if cls.contract != CONTRACT:
        yield f"written for contract {cls.contract}, this spherekit has {CONTRACT}"
    if cls.__abstractmethods__:
        yield f"methods missing: {listing(sorted(cls.__abstractmethods__))}"
    params = getattr(cls, "__dataclass_params__", None)
    if not is_dataclass(cls) or params is None or not params.frozen:
        yield "the class is not a frozen dataclass; put @dataclass(frozen=True) before it"
        return
    try:
        parameters(cls)
    except Exception as problem:
        yield f"the types of its parameters cannot be read: {described(problem)}"
    yield from _tables(cls.tables)


def _tables(tables: Sequence[Table]) -> Iterator[str]:
    for table in tables:
        if not NAME_PATTERN.fullmatch(table.name):
            yield f"the name {table.name!r} of a table is not letters, digits, underscores"
        if not isinstance(table.columns, tuple) or not table.columns:
            yield f"table {table.name}: columns have to be a tuple with at least one Column"
        for column in table.columns:
            where = f"table {table.name}: column {column.name}"
            if not NAME_PATTERN.fullmatch(column.name):
                yield f"{where}: its name is not letters, digits and underscores"
            if not is_unit(column.unit):
                yield (
                    f"{where}: {column.unit!r} is not a unit; tables are in SI units and "
                    "rad, such as rad, rad/s or kg m2/rad, of "
                    f"{listing(sorted(UNIT_SYMBOLS), len(UNIT_SYMBOLS))} "
                    "(--deg converts angles)"
                )
        ways = groupby(column.turns for column in table.columns)
        if any(len(list(group)) % 3 for way, group in ways if way == "vector"):
            yield f"table {table.name}: the columns of a vector come in threes: x, y, z"
        names = [column.name for column in table.columns]
        if len(set(names)) < len(names):
            yield f"table {table.name}: two columns have one name: {listing(names)}"
    if len({table.name for table in tables}) < len(tables):
        yield f"two tables have one name: {listing(table.name for table in tables)}"


_POLES = ("directions", "rates", "planes", "turns")
_PAIRS = ("pair_values", "continued_values", "pair_rates")
_LINKS = ("rotations", "link_rates")


def declared(analysis: AbstractAnalysis, mechanism: Mechanism) -> Needs:
    """Return what an analysis needs of a mechanism.

    Raises
    ------
    PluginError
        If the analysis breaks the contract: its class, or the types, links or pairs in
        what it returns.
    SpherekitError
        With which it refuses the mechanism, or its parameters.
    """
    name = getattr(analysis, "name", type(analysis).__name__)
    fault = "" if isinstance(analysis, BrokenAnalysis) else fault_of_class(type(analysis))
    if not fault:
        with faults_of(name, "needs"):
            needs = analysis.needs(mechanism)
        fault = _fault(needs, mechanism)
    if fault:
        raise PluginError(f"{name}: {fault}")
    return needs


def _fault(needs: Any, mechanism: Mechanism) -> str:
    """Return what is wrong with a pole, pair or link that is declared, or nothing."""
    if not isinstance(needs, Needs):
        return f"needs returns a {type(needs).__name__}, it has to return Needs(...)"
    for field, annotation in get_type_hints(Needs).items():
        if fault := type_fault(field, getattr(needs, field), annotation):
            return f"Needs: {fault}"
    count = len(mechanism.links)
    name = mechanism.name
    for what, held in vars(needs).items():
        for item in held if isinstance(held, frozenset) else ():
            fault = ""
            if what in (*_POLES, "links"):
                ends = np.ravel(item)
                if np.any((ends < 0) | (ends >= count)):
                    fault = f", but the links of {name} have the numbers 0 to {count - 1}"
                elif not np.all(ends[:-1] < ends[1:]):
                    fault = "; pole_of(link, other) puts the smaller first"
            else:
                is_link = what in _LINKS
                kind = "link" if is_link else "pair"
                names = mechanism.link_number if is_link else mechanism.pair_number
                if item not in names:
                    fault = (
                        f", but {name} has no {kind} of that name"
                        f"{choices(item, names, f'{kind}s')}"
                    )
                elif what in _PAIRS and mechanism.pair(item).kind.variable_count > 1:
                    fault = ", a pair with two variables, which has no single one"
            if fault:
                return f"Needs({what}=...) holds {item!r}{fault}"
    return ""
