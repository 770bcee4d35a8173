"""Formulas as assignments of a programming language, one for each operation.

Expressions are graphs in which an expression that occurs twice is one node, so each value
is computed once. C returns the same numbers as NumPy's arrays. For comparison, code that
CasADi generates from the same expressions has 2 to 6 % fewer operations. CasADi's code has
squares and changes of sign as operations of their own.
"""

import re
from collections.abc import Iterator, Mapping, Sequence
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from spherekit.exchange.formula_expressions import Formulas, SmoothModes
from spherekit.exchange.identifiers import unique_names
from spherekit.exchange.source_language import Language
from spherekit.exchange.source_text import bracketed_number, number
from spherekit.symbolic.expression_graph import Expr, ExpressionNode, iterate_nodes


class SourceFunction(NamedTuple):
    """The body of a function in a programming language, without its head.

    Attributes
    ----------
    name
        Name of the function.
    lines
        The statements. Calls come first that evaluate stored Chebyshev series, such as the
        coordinates of a contact profile. Then follows one assignment for each operation.
    results
        The values that the function returns: names or numbers.
    closure_residual
        Name of the variable with the closure residual (how far loops are open); empty
        unless the function is a step of Newton's method.
    used_arguments
        Names of the arguments that the lines contain.
    """

    name: str
    lines: list[str]
    results: list[str]
    closure_residual: str
    used_arguments: set[str]


class FormulaSource:
    """Formulas with their names and assignments in a programming language.

    Parameters
    ----------
    formulas, language
        The formulas and the language.

    Attributes
    ----------
    formulas, language
        The formulas and the language.
    name
        Name of the function, which the language allows.
    result_names
        Names of the results in their order, in letters that identifiers allow.
    mode_argument
        Name of the argument that selects the assembly mode (way to assemble the mechanism).
        In closed form it is ``mode``, with the signs of the dyads (groups of two links).
        Otherwise the name is ``variables``: pair variables from which Newton's method
        starts.
    arguments
        Names of the three arguments, in the order of `Formulas.variables`: the motion,
        `mode_argument`, and the sizes.
    smooth_function
        Name of the function that returns the values of `mode_argument` at an input, for a
        mode that follows a smooth curve through crossings.
    """

    def __init__(self, formulas: Formulas, language: Language) -> None:
        """Choose names that the language allows; the lines are written on request."""
        self.formulas = formulas
        self.language = language
        self.name = language.name_rules.identifier(formulas.mechanism.name)
        self.result_names = unique_names(
            re.sub(r"\W", "_", name, flags=re.ASCII) for name in formulas.results
        )
        self.mode_argument = "variables" if formulas.step else "mode"
        self.arguments = ("motion", self.mode_argument, "size")
        self.smooth_function = f"{self.name}_smooth_{self.mode_argument}"

    @cached_property
    def functions(self) -> list[SourceFunction]:
        """The function of the results, and one for Newton's step if this is used."""
        functions = [self._write_function(self.name, self.formulas.outputs)]
        if self.formulas.step:
            step_name = f"{self.name}_step"
            functions.append(self._write_function(step_name, self.formulas.step))
        return functions

    def _write_function(self, name: str, outputs: Sequence[Expr]) -> SourceFunction:
        """Return a function that computes some expressions, as assignments of the language.

        Expressions are graphs of operations. The value of each operation is assigned once
        to a new name: t0, t1, and so on. Symbols in the expressions are elements of the
        arguments, or columns of stored series.

        Parameters
        ----------
        name
            Name of the function.
        outputs
            The expressions. The expressions of a step of Newton's method end with the
            closure residual: how far the loops were open before the step.
        """
        language = self.language
        formulas = self.formulas
        first_index = language.first_index
        # The text of each expression: an element of an argument, a column of a stored
        # series, or a local name.
        text_by_node: dict[ExpressionNode, str] = {}
        for argument, terms in zip(self.arguments, formulas.variables, strict=True):
            for index, term in enumerate(terms, first_index):
                text_by_node[term] = f"{argument}[{index}]"
        table_by_term: dict[ExpressionNode, int] = {}
        for table_number, table in enumerate(formulas.tables):
            for index, term in enumerate(table.terms, first_index):
                table_by_term[term] = table_number
                text_by_node[term] = f"table_{table_number}[{index}]"

        lines: list[str] = []
        call_by_table: dict[int, str] = {}
        used_arguments: set[str] = set()
        for node in iterate_nodes(outputs):
            if node.operation != "variable":
                operands = [self._operand(x, text_by_node) for x in node.arguments]
                text_by_node[node] = f"t{len(lines)}"
                value = language.operation_formats[node.operation].format(*operands)
                lines.append(language.assignment_format.format(text_by_node[node], value))
                continue
            # The node is the symbol of an argument, or of a stored series. The variable of
            # a series is an argument.
            argument_node = node
            if node in table_by_term:
                table_number = table_by_term[node]
                table = formulas.tables[table_number]
                argument_node = table.variable
                variable = text_by_node[table.variable]
                call_by_table[table_number] = language.table_format.format(
                    k=table_number,
                    name=self.name,
                    argument=f"{variable} + {self._literal(table.start)}",
                    columns=len(table.terms),
                )
            argument, _, _ = text_by_node[argument_node].partition("[")
            used_arguments.add(argument)
        results = [self._operand(output, text_by_node) for output in outputs]
        closure_residual = results.pop() if outputs is formulas.step else ""
        return SourceFunction(
            name=name,
            lines=[*call_by_table.values(), *lines],
            results=results,
            closure_residual=closure_residual,
            used_arguments=used_arguments,
        )

    def _operand(self, item: Expr, text_by_node: Mapping[ExpressionNode, str]) -> str:
        """Return an expression or number as an operand; negative numbers have brackets."""
        if isinstance(item, ExpressionNode):
            return text_by_node[item]
        if np.isnan(item):
            return self.language.nan_literal
        text = self._literal(float(item))
        return f"({text})" if text[0] == "-" else text

    def _literal(self, value: float) -> str:
        """Return a number as the language writes it."""
        return self.language.literal_format.format(number(value))

    @property
    def helpers(self) -> list[str]:
        """Functions that the formulas need and the language does not have."""
        expressions = [*self.formulas.outputs, *self.formulas.step]
        operations = {node.operation for node in iterate_nodes(expressions)}
        return [
            helper
            for operation, helper in self.language.helper_by_operation.items()
            if operation in operations
        ]

    @property
    def smooth_modes(self) -> SmoothModes | None:
        """The mode values of modes that follow smooth curves through crossings.

        Mode values are the numbers that select an assembly mode in the formulas. The result
        is None if modes do not change their values at crossings, or the formulas need no
        mode values.
        """
        return self.formulas.mode_table.smooth if self.formulas.mode_value_names else None

    @property
    def smooth_mode_fields(self) -> dict[str, Any]:
        """Names and numbers that are inserted in the template of `smooth_function`.

        An assembly mode (way to assemble the mechanism) is selected by a few numbers, its
        mode values, such as the sign 1 or -1 of each dyad (two links). The curves of
        configurations of two modes can cross. A mode that follows its smooth curve through
        a crossing can have other mode values beyond it. The crossings therefore divide the
        range of the input into intervals.

        `smooth_function` is a function of the generated source that returns the mode values
        for a mode and an input. The function has a table with a row for each interval and
        mode. Keys of the result are:

        - ``name``, ``mode``: names of the function and of the argument that selects a mode,
        - ``low``, ``high``, ``period``: range and period of the input (rad), as text,
        - ``intervals``, ``modes``, ``count``: the numbers of intervals, of modes, and of
          values in a row of the table.
        """
        smooth_modes = self.smooth_modes
        assert smooth_modes is not None
        interval_count, mode_count, value_count = smooth_modes.mode_values.shape
        return {
            "name": self.smooth_function,
            "mode": self.mode_argument,
            # These two are subtracted in the template, so a negative one needs brackets.
            "low": bracketed_number(smooth_modes.low),
            "high": bracketed_number(smooth_modes.high),
            "period": number(smooth_modes.period),
            "intervals": interval_count,
            "modes": mode_count,
            "count": value_count,
        }

    @property
    def is_periodic(self) -> bool:
        """Whether all configurations return after a period of the only input."""
        return self.smooth_modes is not None and bool(np.isfinite(self.smooth_modes.period))

    @property
    def series_fields(self) -> Iterator[dict[str, Any]]:
        """For each stored series the values that are inserted in its template.

        A stored series evaluates several functions of one variable, such as the coordinates
        of a contact profile. The range of the variable is divided into cells. In each cell
        each function is a sum of Chebyshev polynomials. A template is source code with
        fields in braces. Keys of the values are:

        - ``name``: name of the function of the mechanism in the generated source,
        - ``k``: number of the series,
        - ``cells``, ``columns``: numbers of the cells and of the functions,
        - ``order``: number of coefficients of a function in a cell (its degree plus 1),
        - ``edges`` (cells + 1,): the ends of the cells,
        - ``coefficients`` (cells, columns, order),
        - ``closed``: whether the functions are periodic, as on a closed curve,
        - ``length``, ``low``, ``high``: the period and the ends of the range, as text.
        """
        for table_number, table in enumerate(self.formulas.tables):
            # The templates need the coefficients of one function beside each other, so the
            # axes (cells, order, columns) become (cells, columns, order).
            coefficients = np.swapaxes(table.series.coefficients, 1, 2)
            cell_count, column_count, order = coefficients.shape
            yield {
                "name": self.name,
                "k": table_number,
                "cells": cell_count,
                "columns": column_count,
                "order": order,
                "edges": table.series.edges,
                "coefficients": coefficients,
                "length": self._literal(table.length),
                "low": self._literal(table.series.edges[0]),
                "high": self._literal(table.series.edges[-1]),
                "closed": table.closed,
            }
