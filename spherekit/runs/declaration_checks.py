"""Checks of the class of an analysis and of its needs, before anything is computed."""

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import fields, is_dataclass
from functools import cache
from itertools import groupby
from typing import Any, get_args, get_type_hints

import numpy as np

from spherekit.conventions import NAME_PATTERN
from spherekit.errors import PluginError
from spherekit.mechanism.mechanism import Mechanism
from spherekit.runs.analysis_faults import convert_plugin_errors, describe_exception
from spherekit.runs.contract import CONTRACT, AbstractAnalysis, BrokenAnalysis
from spherekit.runs.needs import Needs
from spherekit.runs.parameter_text import describe_parameters
from spherekit.runs.run_result import MOTION
from spherekit.tables.column_units import UNIT_SYMBOLS, is_unit
from spherekit.tables.table import COLUMNS, Table
from spherekit.type_checks import type_fault
from spherekit.wording import choices, listing

RESERVED_NAMES = (MOTION, COLUMNS.partition(".")[0])
"""Names that no analysis may have: the stems of files that every run writes."""


def find_class_fault(cls: Any) -> str:
    """Return why a class cannot be used as an analysis, empty if it can."""
    return next(_find_class_faults(cls), "")


def _find_class_faults(cls: Any) -> Iterator[str]:
    """Yield a phrase for each fault in the class of an analysis.

    An analysis is a frozen dataclass derived from `AbstractAnalysis`. Other people can
    write analyses as plugins. Therefore the class attributes, methods, parameters and
    tables are checked.

    The caller reads only the first fault, because an earlier fault can make a later check
    fail.
    """
    if not (isinstance(cls, type) and issubclass(cls, AbstractAnalysis)):
        yield f"{cls!r} is not a subclass of AbstractAnalysis"
        return
    # The class attributes, such as `name`. `get_args` takes the type T out of their
    # annotations ClassVar[T].
    for key, hint in get_type_hints(AbstractAnalysis).items():
        if not hasattr(cls, key):
            yield f"the class attribute `{key}` is missing"
            return
        if fault := type_fault(key, getattr(cls, key), *get_args(hint)):
            yield f"the class attribute {fault}"
    if not NAME_PATTERN.fullmatch(cls.name):
        yield f"its name {cls.name!r} may contain only letters, digits and underscores"
    if cls.name in RESERVED_NAMES:
        yield f"its name {cls.name!r} is that of a file that every run writes"
    # The contract is the version number of the interface between spherekit and plugins.
    if cls.contract != CONTRACT:
        yield (
            f"it is written for contract {cls.contract}, but this spherekit has {CONTRACT}"
        )
    if cls.__abstractmethods__:
        yield f"methods missing: {listing(sorted(cls.__abstractmethods__))}"
    dataclass_parameters = getattr(cls, "__dataclass_params__", None)
    is_frozen = dataclass_parameters is not None and dataclass_parameters.frozen
    if not is_dataclass(cls) or not is_frozen:
        yield "the class is not a frozen dataclass; put @dataclass(frozen=True) before it"
        return
    try:
        describe_parameters(cls)
    except Exception as problem:
        yield f"the types of its parameters cannot be read: {describe_exception(problem)}"
    yield from _find_table_faults(cls.tables)
    # `on_request` is the parameter by which users request an optional column.
    parameters = [item.name for item in fields(cls)]
    for table in cls.tables:
        for column in table.columns:
            if column.on_request and column.on_request not in parameters:
                yield (
                    f"table {table.name}: column {column.name}: on_request is "
                    f"{column.on_request!r}, which is not a parameter; parameters: "
                    f"{listing(parameters) or 'none'}"
                )


def _find_table_faults(tables: Sequence[Table]) -> Iterator[str]:
    """Yield a phrase for each fault in the tables that an analysis declares.

    Other people can write analyses as plugins, so the names, units and order of the columns
    are checked.
    """
    for table in tables:
        if fault := _find_field_fault(table):
            yield f"table {table.name}: {fault}"
        if not NAME_PATTERN.fullmatch(table.name):
            yield (
                f"the name {table.name!r} of a table may contain only letters, digits and "
                "underscores"
            )
        if not isinstance(table.columns, tuple) or not table.columns:
            yield f"table {table.name}: columns have to be a tuple with at least one Column"
        for column in table.columns:
            where = f"table {table.name}: column {column.name}"
            if fault := _find_field_fault(column):
                yield f"{where}: {fault}"
            if not NAME_PATTERN.fullmatch(column.name):
                yield f"{where}: its name may contain only letters, digits and underscores"
            if not is_unit(column.unit):
                yield (
                    f"{where}: {column.unit!r} is not a unit; tables are in SI units and "
                    "rad, such as rad, rad/s or kg m2/rad, of "
                    f"{listing(sorted(UNIT_SYMBOLS), len(UNIT_SYMBOLS))} "
                    "(--deg converts angles)"
                )
        # The attribute `turns` of a column says how its numbers change if the mechanism is
        # rotated as a whole. Columns with "vector" are components of vectors. The three
        # components x, y, z have to be neighbours, so the number of successive "vector"
        # columns is a multiple of 3.
        for behaviour, group in groupby(column.turns for column in table.columns):
            component_count = len(list(group))
            if behaviour == "vector" and component_count % 3:
                yield f"table {table.name}: the columns of a vector come in threes: x, y, z"
                break
        names = [column.name for column in table.columns]
        if len(set(names)) < len(names):
            yield f"table {table.name}: two columns have the same name: {listing(names)}"
    if len({table.name for table in tables}) < len(tables):
        yield f"two tables have the same name: {listing(table.name for table in tables)}"


_field_types = cache(get_type_hints)


def _find_field_fault(declaration: Any) -> str:
    """Return why a field of a declaration has a wrong type, empty if none has.

    The declaration is a table, a column or the needs of an analysis.
    """
    cls: Any = type(declaration)
    for field, annotation in _field_types(cls).items():
        if fault := type_fault(field, getattr(declaration, field), annotation):
            return fault
    return ""


NEEDS_OF_LINK_NUMBERS = ("directions", "rates", "planes", "turns", "links")
"""Fields of `Needs` with numbers of links, or pairs of them."""

NEEDS_OF_SINGLE_VARIABLES = ("pair_values", "continued_values", "pair_rates")
"""Fields of `Needs` with names of pairs that must have one variable."""

NEEDS_OF_LINK_NAMES = ("rotations", "link_rates")
"""Fields of `Needs` with names of links."""


def check_needs(analysis: AbstractAnalysis, mechanism: Mechanism) -> Needs:
    """Return the quantities that an analysis reads for a mechanism, after checks.

    A run computes only these quantities. An analysis may be a plugin by other people, so
    its class and its declaration are checked.

    Raises
    ------
    PluginError
        If the class of the analysis is faulty, or if it declares links or pairs that do not
        exist, values of a wrong type, or columns with equal names for the mechanism.
    SpherekitError
        If the analysis itself refuses the mechanism or its parameters.
    """
    name = getattr(analysis, "name", type(analysis).__name__)
    # A `BrokenAnalysis` replaces an analysis that cannot be used. Its method `needs`
    # raises the reason.
    is_placeholder = isinstance(analysis, BrokenAnalysis)
    fault = "" if is_placeholder else find_class_fault(type(analysis))
    if not fault:
        with convert_plugin_errors(name, "needs"):
            needs = analysis.needs(mechanism)
        fault = _find_needs_fault(needs, mechanism) or _find_repeated_column(
            analysis, mechanism
        )
    if fault:
        raise PluginError(f"{name}: {fault}")
    return needs


def _find_needs_fault(needs: Any, mechanism: Mechanism) -> str:
    """Return what is wrong with declared needs, empty if nothing is."""
    if not isinstance(needs, Needs):
        return f"needs returns a {type(needs).__name__}; it has to return Needs(...)"
    if fault := _find_field_fault(needs):
        return f"Needs: {fault}"
    for field, value in vars(needs).items():
        for item in value if isinstance(value, frozenset) else ():
            if fault := _find_item_fault(field, item, mechanism):
                return f"Needs({field}=...) holds {item!r}{fault}"
    return ""


def _find_repeated_column(analysis: AbstractAnalysis, mechanism: Mechanism) -> str:
    """Return which table has columns of equal names for a mechanism, empty if none has.

    A mechanism adds columns to a table: for each input, for each passive variable, and for
    the names of its assembly modes (ways to assemble the mechanism).
    """
    for table in analysis.requested_tables():
        columns = table.of(mechanism).with_names(mechanism).columns
        for name, count in Counter(column.name for column in columns).items():
            if count > 1:
                return f"table {table.name}: {count} columns have the name {name!r}"
    return ""


def _find_item_fault(field: str, item: Any, mechanism: Mechanism) -> str:
    """Return what is wrong with a declared pole, pair or link, or an empty text.

    An analysis declares in its `Needs` of which poles (axes of the relative rotation of two
    links), pairs (joints) and links it reads angles, velocities and other quantities.

    Parameters
    ----------
    field
        Name of the field of `Needs` that contains the item.
    item
        The index of a link, a pole (indices of two links, the smaller index first), or the
        name of a link or pair.
    mechanism
        The mechanism to which the item belongs.

    Returns
    -------
    The end of a sentence that begins with the item.
    """
    name = mechanism.name
    if field in NEEDS_OF_LINK_NUMBERS:
        link_count = len(mechanism.links)
        link_numbers = np.ravel(item)
        if np.any((link_numbers < 0) | (link_numbers >= link_count)):
            return f", but the links of {name} have the numbers 0 to {link_count - 1}"
        if not np.all(link_numbers[:-1] < link_numbers[1:]):
            return "; pole_of(link, other) puts the smaller first"
        return ""
    is_link = field in NEEDS_OF_LINK_NAMES
    kind = "link" if is_link else "pair"
    names = mechanism.link_number if is_link else mechanism.pair_number
    if item not in names:
        return f", but {name} has no {kind} of that name{choices(item, names, f'{kind}s')}"
    has_to_be_single = field in NEEDS_OF_SINGLE_VARIABLES
    # An analysis reads one number for each pair in these fields. A sliding contact has two
    # variables, for example, so it cannot be declared there.
    if has_to_be_single and mechanism.pair(item).kind.variable_count > 1:
        return ", a pair with two variables, which has no single one"
    return ""
