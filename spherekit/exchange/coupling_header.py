"""A coupling table as a C header: static arrays, and C99 that interpolates between them."""

import json
import re

import numpy as np
from numpy.typing import ArrayLike

from spherekit.arrays import Array, Floats
from spherekit.escaping import c_comment
from spherekit.exchange import identifiers
from spherekit.exchange.coupling_table import CouplingTable
from spherekit.exchange.identifiers import unique_names

HEADER_TEMPLATE = """\
/* Coupling table of the mechanism {mechanism}, made by spherekit {made_by}.
   SHA-256 of the mechanism: {sha256}

   Inputs (rad): {inputs}
   Passive variables: {variables}
   Angular velocities, in ground axes: {poles}
   Largest error, measured between the nodes: {table.angle_error:.2g} rad of an angle,
   {table.coefficient_error:.2g} of a coefficient.

   C99, no library but <math.h>. Angles continue without a jump through a cell. Cells in
   which a jump, a change of assembly mode or the end of one is possible are not used.

   Example: {example_title}

       double q[{m}] = {{{example_inputs}}};
       double angle[{k}], coefficient[{k}][{m}];
       if ({name}_at({example_mode}, q, angle, coefficient, 0, 0) == {guard}_OK)
           printf("%.9g\\n", angle[{name}_{first_variable}]);
*/
#ifndef {guard}_COUPLING_H
#define {guard}_COUPLING_H

#include <math.h>

enum {{
    {guard}_INPUTS = {m},
    {guard}_VARIABLES = {k},
    {guard}_POLES = {p},
    {guard}_MODES = {table.error.shape[0]},
    {guard}_NODES = {table.angles.shape[1]},
    {guard}_CELLS = {table.error.shape[1]}
}};

/* What {name}_at returns. */
enum {{ {guard}_OK = 0, {guard}_NO_MODE = 1, {guard}_OUTSIDE = 2, {guard}_NOT_SURE = 3 }};

/* Places of the variables in the results. */
enum {{{enums}
}};

static const int {name}_mode[] = {{{mode_numbers}}};
static const double {name}_start[] = {{{start}}};
static const double {name}_step[] = {{{step}}};
static const int {name}_count[] = {{{count}}};
static const int {name}_periodic[] = {{{periodic}}};
{arrays}

/* Read the table at inputs q (rad).

   mode         number of the assembly mode
   angle        passive variables (rad)
   coefficient  their rates per unit rate of each input
   derivative   of the coefficients by each input (1/rad)
   turning      angular velocities per unit rate of each input
   Any of the results may be a null pointer. */
static int {name}_at(int mode, const double q[{m}], double angle[{k}],
                     double coefficient[{k}][{m}], double derivative[{k}][{m}][{m}],
                     double turning[{p1}][{m}][3])
{{
    int cell[{m}], number = -1, index = 0;
    double at[{m}], turns[{m}];
    for (int k = 0; k < {guard}_MODES; ++k)
        if ({name}_mode[k] == mode)
            number = k;
    if (number < 0)
        return {guard}_NO_MODE;
    for (int i = 0; i < {m}; ++i) {{
        const int last = {name}_count[i] - 1;
        double along = (q[i] - {name}_start[i]) / {name}_step[i];
        turns[i] = {name}_periodic[i] ? floor(along / last) : 0.0;
        along -= turns[i] * last;
        if (!(along >= -1e-9 && along <= last + 1e-9))
            return {guard}_OUTSIDE;
        cell[i] = (int)floor(along);
        if (cell[i] < 0)
            cell[i] = 0;
        if (cell[i] > last - 1)
            cell[i] = last - 1;
        at[i] = along - cell[i];
        index = index * last + cell[i];
    }}
    if (!{name}_sure[number][index])
        return {guard}_NOT_SURE;
    for (int v = 0; v < {k}; ++v) {{
        double f = 0.0, g[{m}] = {{0.0}}, h[{m}][{m}] = {{{{0.0}}}};
        for (int i = 0; i < {m}; ++i)
            f += turns[i] * {name}_rise[number][i][v];
        for (int corner = 0; corner < (1 << {m}); ++corner) {{
            double weight = 1.0, d[{m}], grown = 0.0;
            int node = 0;
            for (int i = 0; i < {m}; ++i) {{
                const int up = (corner >> i) & 1;
                weight *= up ? at[i] : 1.0 - at[i];
                d[i] = (at[i] - up) * {name}_step[i];
                node = node * {name}_count[i] + cell[i] + up;
            }}
            for (int i = 0; i < {m}; ++i) {{
                double bent = 0.0;
                for (int j = 0; j < {m}; ++j) {{
                    bent += {name}_derivative[number][node][v][i][j] * d[j];
                    h[i][j] += weight * {name}_derivative[number][node][v][i][j];
                }}
                const double slope = {name}_coefficient[number][node][v][i];
                grown += (2.0 / 3.0 * slope + bent / 6.0) * d[i];
                g[i] += weight * (slope + 0.5 * bent);
            }}
            f += weight * ({name}_angle[number][node][v] + grown);
        }}
        if (angle)
            angle[v] = f;
        for (int i = 0; i < {m}; ++i) {{
            if (coefficient)
                coefficient[v][i] = g[i];
            for (int j = 0; derivative && j < {m}; ++j)
                derivative[v][i][j] = h[i][j];
        }}
    }}
{turning_code}    return {guard}_OK;
}}

#endif
"""
"""Template of the header. Fields in braces; m inputs, k variables, p poles."""

TURNING_TEMPLATE = """\
    for (int p = 0; turning && p < {p}; ++p)
        for (int i = 0; i < {m}; ++i)
            for (int x = 0; x < 3; ++x) {{
                double w = 0.0;
                for (int corner = 0; corner < (1 << {m}); ++corner) {{
                    double weight = 1.0, grown = 0.0;
                    int node = 0;
                    for (int j = 0; j < {m}; ++j) {{
                        const int up = (corner >> j) & 1;
                        weight *= up ? at[j] : 1.0 - at[j];
                        node = node * {name}_count[j] + cell[j] + up;
                    }}
                    for (int j = 0; j < {m}; ++j) {{
                        const double d = (at[j] - ((corner >> j) & 1)) * {name}_step[j];
                        grown += d * {name}_turning_derivative[number][node][p][i][j][x];
                    }}
                    w += weight * ({name}_turning[number][node][p][i][x] + 0.5 * grown);
                }}
                turning[p][i][x] = w;
            }}
"""
"""Template of the statements that interpolate angular velocities."""


def header(table: CouplingTable) -> str:
    """Return the text of a C header with a coupling table and the function that reads it.

    A coupling table has the angles of passive joints over the inputs, for controllers. Its
    arrays become static arrays of C. All names in the header begin with the name of the
    mechanism.
    """
    name = identifiers.C_NAME_RULES.identifier(table.mechanism)
    # POSIX defines macros such as X_OK, which a mechanism called x would define again.
    if identifiers.C_NAME_RULES.is_taken(f"{name.upper()}_OK"):
        name = f"m_{name}"
    variable_names = unique_names(
        re.sub(r"\W", "_", variable, flags=re.ASCII) for variable in table.variables
    )
    enumerators = ",".join(
        f"\n    {name}_{variable} = {index}"
        for index, variable in enumerate(variable_names)
    )
    pole_count = len(table.poles)
    sizes = {
        "m": len(table.inputs),
        "k": len(table.variables),
        "p": pole_count,
        "name": name,
    }
    array_by_declaration = {
        f"double {name}_rise": table.rise,
        f"unsigned char {name}_sure": table.sure.astype(int),
        f"double {name}_angle": table.angles,
        f"double {name}_coefficient": table.coefficients,
        f"double {name}_derivative": table.derivatives,
    }
    turning_code = "    (void)turning;\n"
    if pole_count:
        array_by_declaration[f"double {name}_turning"] = table.turning
        array_by_declaration[f"double {name}_turning_derivative"] = (
            table.turning_derivatives
        )
        turning_code = TURNING_TEMPLATE.format(**sizes)
    arrays = [
        _format_array(declaration, values)
        for declaration, values in array_by_declaration.items()
    ]
    example_row, example_inputs = _find_example(table)
    return HEADER_TEMPLATE.format(
        **sizes,
        example_title=f"assembly mode {table.modes[example_row]} in the middle of a cell.",
        example_mode=table.modes[example_row],
        example_inputs=_format_row(example_inputs),
        first_variable=variable_names[0],
        table=table,
        mechanism=c_comment(table.mechanism),
        made_by=c_comment(table.made_by),
        sha256=c_comment(table.mechanism_sha256),
        inputs=c_comment(", ".join(table.inputs)),
        variables=c_comment(", ".join(table.variables)),
        poles=c_comment(", ".join(table.poles) or "none"),
        guard=name.upper(),
        p1=max(pole_count, 1),  # C has no arrays of length 0.
        enums=enumerators,
        mode_numbers=_format_row(table.modes),
        start=_format_row(table.start),
        step=_format_row(table.step),
        count=_format_row(table.count),
        periodic=_format_row(table.periodic.astype(int)),
        arrays="\n".join(arrays),
        turning_code=turning_code,
    )


def _find_example(table: CouplingTable) -> tuple[int, Floats]:
    """Return an assembly mode and inputs (rad) for the example in the header.

    The mode is the index of a row of the table. The inputs (inputs,) are the middle of the
    first sure cell (a box of the grid in which the measured error is small enough). If no
    cell is sure, the first cell is taken.
    """
    row, cell = np.unravel_index(int(np.argmax(table.sure)), table.sure.shape)
    cell_numbers = np.unravel_index(int(cell), np.asarray(table.count) - 1)
    middle = np.asarray(table.start) + (np.array(cell_numbers) + 0.5) * table.step
    return int(row), middle


def _format_array(declaration: str, values: Array) -> str:
    """Return an array of a coupling table as a static array of C.

    A coupling table has values of several assembly modes (ways to assemble the links) at
    the nodes of a grid of inputs. Each node of each mode gets one line.

    Parameters
    ----------
    declaration
        Type and name of the array in C.
    values
        (modes, nodes, ...) values of the array.
    """
    shape = "".join(f"[{length}]" for length in values.shape)
    lines = ""
    for nodes in values:
        node_lines = ",\n".join(f"    {_format_nested(node)}" for node in nodes)
        lines += f"  {{\n{node_lines}\n  }},\n"
    return f"static const {declaration}{shape} = {{\n{lines}}};"


def _format_nested(values: ArrayLike) -> str:
    """Return an array as nested braces, with which C initialises an array.

    Values are NaN where an assembly mode does not exist. NaN becomes zero, which the C
    function never reads.
    """
    text = json.dumps(np.nan_to_num(values).tolist())
    return text.replace("[", "{").replace("]", "}")


def _format_row(values: ArrayLike) -> str:
    """Return a row of numbers without the outer braces, which the template has."""
    return _format_nested(values)[1:-1]
