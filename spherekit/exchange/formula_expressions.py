"""Data classes for the explicit formulas of a mechanism.

`spherekit.exchange.formula_maker` creates them. `spherekit.exchange.source_languages`
prints them as source code in a programming language.

A *term* is a symbol or an operation in an expression graph. The formulas have three groups
of arguments:

- the *motion*: inputs (rad), and rates, accelerations, loads if results depend on them;
- the *mode values*: numbers that select the assembly mode. In closed form they are the
  sign (+1 or -1) of each dyad. Otherwise they are approximate variables (rad) of all pairs,
  which Newton's method improves;
- the *sizes*: numbers of the mechanism file that the user has chosen as arguments.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from spherekit.arrays import Floats
from spherekit.conventions import Names
from spherekit.mechanism.mechanism import Mechanism
from spherekit.numerics.chebyshev import PiecewiseChebyshev
from spherekit.symbolic.expression_evaluation import array_function
from spherekit.symbolic.expression_graph import Expr, ExpressionNode, iterate_nodes

FormulaFunction = Callable[[Floats, Floats, Floats], Floats]
"""A function of the arrays motion, mode values and sizes; see `Formulas.numpy_function`."""


class Argument(NamedTuple):
    """An argument of the formulas of a mechanism in generated source code.

    It is an element of the motion (inputs, rates and so on) or of the sizes (numbers of the
    mechanism file that may vary).

    Attributes
    ----------
    name
        Name of the argument in the source code.
    unit
        Unit of the argument, ``"as in the file"`` for sizes that are not angles.
    value
        Value of a size in the mechanism file, in `unit`; 0 for the motion.
    key
        Key of a size in the mechanism file, such as ``"links.2.arc"``; empty for the
        motion.
    """

    name: str
    unit: str
    value: float = 0.0
    key: str = ""


class Mode(NamedTuple):
    """An assembly mode (way to assemble the mechanism) in generated source code.

    Attributes
    ----------
    number, name
        Index and title of the mode in the mechanism.
    at
        The inputs (rad) of one known configuration of the mode.
    values
        The numbers that select the mode in the formulas. In closed form they are signs, one
        for each dyad (group of two links), that choose one of its two positions.
        Otherwise the values are the pair variables (joint angles, rad) of the known
        configuration, from which Newton's method starts.
    """

    number: int
    name: str
    at: tuple[float, ...]
    values: tuple[float, ...]


class ModePiece(NamedTuple):
    """A part of the input's range in which the numbers that select a mode are constant.

    A mode is one way to assemble the mechanism, which has a single input. The part ends
    where the next part begins, the last part at the end of the range.

    Attributes
    ----------
    start
        Input (rad) at which the part begins.
    known_input
        Input (rad) of a known configuration of the mode in this part.
    mode_values
        (values,) the numbers that select the mode in the formulas: the signs of its dyads
        (groups of two links), or the pair variables (joint angles, rad) from which Newton's
        method starts.
    """

    start: float
    known_input: float
    mode_values: Floats


class SmoothModes(NamedTuple):
    """The mode values of assembly modes that follow smooth curves through crossings.

    An assembly mode is one way to assemble the links. Mode values are the numbers that
    select it in the formulas: the signs of its dyads (groups of two links), or the
    variables (rad) from which Newton's method starts. At a crossing two curves of
    configurations meet.

    Intervals divide the range of the only input, since the mode values can change at each
    crossing. A short interval surrounds each crossing, because rounding decides on which
    side of the crossing an input in this interval is. Modes with changing signs have the
    mode values NaN there.

    Attributes
    ----------
    low, high
        Ends of the range of the input (rad).
    period
        Growth of the input (rad) after which all configurations return, infinite if they
        never return. An input outside of the range is moved by whole periods, into the
        range if possible.
    crossings
        Inputs (rad) in the range at which curves are known to cross.
    are_all_known
        Whether curves cross nowhere else in the range.
    starts
        (intervals,) the input (rad) at which each interval begins; the first is -inf.
    mode_values
        (intervals, modes, values) the mode values of each mode in each interval, NaN if no
        configuration of the mode is known there.
    inputs
        (intervals, modes) inputs (rad) of the configurations that have these values, NaN
        if none is known.
    """

    low: float
    high: float
    period: float
    crossings: tuple[float, ...]
    are_all_known: bool
    starts: tuple[float, ...]
    mode_values: Floats
    inputs: Floats

    def pieces(self, mode: int) -> list[ModePiece]:
        """Return the parts of the input's range in which a mode has constant mode values.

        Mode values are the numbers that select the mode in the formulas, such as signs of
        dyads. They can change where the curve of the mode crosses another curve. The head
        of a written source file lists the parts for its users.

        Parameters
        ----------
        mode
            Index of the mode in the arrays of this object.

        Returns
        -------
        The parts in rising order of the input. An interval without a known configuration of
        the mode (NaN) belongs to the part before it, or to no part if there is none before.
        """
        pieces: list[ModePiece] = []
        # `known_input` is an input in the interval at which a configuration of the mode is
        # known. The source file names it as an example.
        for start, known_input, values in zip(
            self.starts, self.inputs[:, mode], self.mode_values[:, mode], strict=True
        ):
            if np.isnan(known_input) or np.any(np.isnan(values)):
                continue
            # An interval with the same values as the last part belongs to that part.
            if not pieces or not np.array_equal(pieces[-1].mode_values, values):
                # The first interval begins at -inf, but the range begins at `low`.
                start_in_range = max(start, self.low)
                pieces.append(ModePiece(start_in_range, float(known_input), values))
        return pieces


class LeftOutMode(NamedTuple):
    """An assembly mode (way to assemble the mechanism) that the generated code leaves out.

    Attributes
    ----------
    number, title
        Index of the mode, and its signs or its name in the file.
    reason
        The reason for which it has no formulas.
    """

    number: int
    title: str
    reason: str

    @property
    def name(self) -> str:
        """The mode in messages, such as ``1 (+-)``, or ``1`` if the title adds nothing."""
        # A title that is not a name has "+" or "-" for each dyad (group of two links), and
        # "~" for each larger group. A title of "~" alone does not tell modes apart.
        if all(character == "~" for character in self.title):
            return f"{self.number}"
        return f"{self.number} ({self.title})"


class ModeTable(NamedTuple):
    """The assembly modes in generated source code, and how they were checked.

    An assembly mode is one of the ways to assemble the mechanism.
    `spherekit.exchange.mode_table` compares the formulas with the mechanism in each mode.

    Attributes
    ----------
    modes
        The modes that are written to the source code.
    left_out
        The other assembly modes.
    undetermined
        Numbers of the modes that are left out because the velocity equations in the
        formulas do not determine their rates. If constraints are redundant, the formulas
        use only some of the velocity equations.
    compared
        Smallest number of inputs at which a mode was compared; 0 if no mode was compared.
    largest_difference
        Largest difference (rad) of a joint angle between the formulas and the mechanism.
    smooth
        The mode values of each mode by intervals of the input. Mode values are the numbers
        that select a mode in the formulas, such as the signs of its dyads (groups of two
        links). Where curves of configurations cross, a mode continues smoothly, but its
        mode values can change. None if each mode has the same mode values everywhere.
    """

    modes: tuple[Mode, ...]
    left_out: tuple[LeftOutMode, ...] = ()
    undetermined: tuple[int, ...] = ()
    compared: int = 0
    largest_difference: float = 0.0
    smooth: SmoothModes | None = None

    def left_out_by_reason(self) -> Mapping[str, Names]:
        """Return the names of the modes that are left out, by the reason."""
        names: dict[str, Names] = {}
        for mode in self.left_out:
            names[mode.reason] = (*names.get(mode.reason, ()), mode.name)
        return names


class SeriesTable(NamedTuple):
    """Functions of one variable that formulas use and that are stored as Chebyshev series.

    Examples are the coordinates of a contact profile as functions of its arc length. The
    range of the variable is divided into cells, each with its own series.

    Attributes
    ----------
    terms
        The symbol in the formulas that stands for each function.
    variable
        The symbol of the variable, which is an argument of the formulas.
    start
        The position at which the variable is 0. The series are functions of the position,
        which is the variable plus `start`.
    series
        The series of all functions, on common cells.
    length
        Period of the functions if `closed` is true, in the unit of the variable.
    closed
        Whether the functions are periodic, as on a closed curve. If not, the functions are
        NaN outside of the cells.
    """

    terms: tuple[ExpressionNode, ...]
    variable: ExpressionNode
    start: float
    series: PiecewiseChebyshev
    length: float
    closed: bool

    def evaluate(self, variable_values: Floats) -> Floats:
        """Return the stored functions (terms, n) at values (n,) of their variable.

        A term is one stored function, such as a coordinate of a contact profile. Values are
        NaN outside of the range of the series.
        """
        edges = self.series.edges  # of the cells, rising
        # The series are functions of the position. `start` is the position at which the
        # variable is 0.
        position = variable_values + self.start
        # A function of a closed curve repeats after each length of the curve.
        if self.closed:
            position = edges[0] + np.mod(position - edges[0], self.length)
        series_rows = self.series.evaluate(position)  # (n, terms)
        # Written as "not inside", so that a position that is NaN gives NaN too.
        series_rows[~((position >= edges[0]) & (position <= edges[-1]))] = np.nan
        return np.asarray(series_rows.T)


@dataclass(frozen=True, eq=False, repr=False)
class Formulas:
    """Explicit formulas of some quantities of a mechanism.

    Attributes
    ----------
    mechanism
        The mechanism, with its driven pairs.
    motion
        The inputs (rad). If a result depends on them, also rates and accelerations of the
        inputs, the time, whole turns (rad) of passive pairs, and torques given by tables.
    mode_value_names
        Names of the values that select the assembly mode (way to assemble the mechanism).
        In closed form they are the signs of the dyads (groups of two links), otherwise the
        variables of all pairs.
    sizes
        The numbers of the mechanism file that are arguments.
    mode_table
        The assembly modes.
    results
        The unit of each result, by the name of the result.
    outputs
        The results as terms, in the order of `results`.
    step
        One step of Newton's method, as terms: the variables of all pairs after the step,
        followed by the closure residual (rad) before it. Empty in closed form.
    variables
        Three tuples with the symbols of all arguments: of the motion, of the mode values
        and of the sizes.
    tables
        Stored series of functions that results or the step contain, such as profiles.
    title
        A short description of the formulas.
    middle_pairs
        In closed form, the middle pair of the dyad of each sign. Where links replace a
        contact, it can be a pair that the mechanism does not have.
    """

    mechanism: Mechanism
    motion: tuple[Argument, ...]
    mode_value_names: Names
    sizes: tuple[Argument, ...]
    mode_table: ModeTable
    results: dict[str, str]
    outputs: tuple[Expr, ...]
    step: tuple[Expr, ...]
    variables: tuple[tuple[ExpressionNode, ...], ...]
    tables: tuple[SeriesTable, ...]
    title: str = "explicit formulas"
    middle_pairs: Names = ()

    @property
    def modes(self) -> tuple[Mode, ...]:
        """The assembly modes that are written to the source code."""
        return self.mode_table.modes

    @property
    def operations(self) -> int:
        """Number of operations that computing all results takes."""
        return sum(term.operation != "variable" for term in iterate_nodes(self.outputs))

    def numpy_function(self, expressions: Sequence[Expr]) -> FormulaFunction:
        """Compile terms of these formulas to a function of arrays.

        Parameters
        ----------
        expressions
            The terms to evaluate, such as `outputs` or `step`.

        Returns
        -------
        A function of three arrays with one row for each argument:

        - motion: inputs (rad), and rates, accelerations, loads if results depend on them,
        - mode values: the signs of the dyads (groups of two links) or approximate variables
          (rad) of all pairs, which select the assembly mode,
        - sizes: numbers of the mechanism file that are arguments.

        Each array has n columns, one for each configuration, or one column that applies to
        all configurations. The function returns an array (expressions, n).
        """
        # The compiled function takes one array. Its rows are the three groups of arguments
        # in turn. After these rows come functions that have no formula and are stored as
        # series, such as the coordinates of a contact profile over its arc length. A table
        # has the symbols of several such functions (`terms`) of one variable.
        row_symbols = [symbol for symbol_group in self.variables for symbol in symbol_group]
        # The row with the variable of each table.
        variable_rows = [row_symbols.index(table.variable) for table in self.tables]
        row_symbols += [symbol for table in self.tables for symbol in table.terms]
        function = array_function(expressions, row_symbols)

        def evaluate(motion: Floats, mode_values: Floats, sizes: Floats) -> Floats:
            """Return the values (expressions, n) of the expressions in n configurations.

            Parameters
            ----------
            motion
                (arguments, n) inputs (rad), and their rates, accelerations and loads if the
                expressions depend on them. A single column applies to all configurations.
            mode_values
                (values, n) or (values, 1) the numbers that select the assembly mode (way to
                assemble the links): signs of dyads (groups of two links), or approximate
                pair variables (rad): joint angles, and arc lengths of contacts.
            sizes
                (sizes, n) or (sizes, 1) numbers of the mechanism file that may vary.
            """
            # Arrays with one column are repeated for all n configurations.
            arguments = (motion, mode_values, sizes)
            (count,) = np.broadcast_shapes(*(argument.shape[1:] for argument in arguments))
            argument_rows = np.concatenate(
                [
                    np.broadcast_to(argument, (len(argument), count))
                    for argument in arguments
                ]
            )
            # Some functions have no formula and are stored as series. Examples are the
            # coordinates of a contact profile. They are functions of an arc length, which
            # is the pair variable of the contact. `variable_rows` says for each table of
            # series in which row of the arguments its variable is.
            series_values = [
                table.evaluate(argument_rows[variable_row])
                for table, variable_row in zip(self.tables, variable_rows, strict=True)
            ]
            return np.asarray(function(np.concatenate([argument_rows, *series_values])))

        return evaluate

    @property
    def size_values(self) -> Floats:
        """(sizes, 1) values of `sizes` in the mechanism file; a new array at each access.

        Sizes are the numbers of the file that are arguments of the formulas. A size with
        the unit ``"as in the file"`` has the value that the file states. Angles are in rad.
        """
        return np.array([size.value for size in self.sizes]).reshape(-1, 1)
