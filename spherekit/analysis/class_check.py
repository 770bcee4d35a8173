"""What a class has to be to be used as an analysis, said before anything is computed.

Tables and columns have judged what they were made of.
"""

from collections.abc import Iterator, Sequence
from dataclasses import is_dataclass
from itertools import groupby
from typing import Any, get_args, get_type_hints

from spherekit.analysis.arguments import parameters
from spherekit.analysis.contract import CONTRACT, AbstractAnalysis
from spherekit.analysis.faults import described
from spherekit.analysis.result import MOTION
from spherekit.analysis.scene import SYMBOLS, is_unit
from spherekit.analysis.tables import COLUMNS, Table
from spherekit.argument_validation import fault_of
from spherekit.conventions import NAME_PATTERN, listing

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
        if fault := fault_of(key, getattr(cls, key), *get_args(hint)):
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
                    f"{listing(sorted(SYMBOLS), len(SYMBOLS))} (--deg converts angles)"
                )
        ways = groupby(column.turns for column in table.columns)
        if any(len(list(group)) % 3 for way, group in ways if way == "vector"):
            yield f"table {table.name}: the columns of a vector come in threes: x, y, z"
        names = [column.name for column in table.columns]
        if len(set(names)) < len(names):
            yield f"table {table.name}: two columns have one name: {listing(names)}"
    if len({table.name for table in tables}) < len(tables):
        yield f"two tables have one name: {listing(table.name for table in tables)}"
