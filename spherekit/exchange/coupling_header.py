"""A coupling table as a C header: static arrays, and C99 that reads between them."""

import re
from collections.abc import Iterable, Iterator

import numpy as np

from spherekit.exchange.coupling import CouplingTable
from spherekit.sphere.rotation import Floats

TEXT = """\
/* Coupling table of the mechanism {mechanism}, made by spherekit {made_by}.
   SHA-256 of the mechanism: {mechanism_sha256}

   Inputs (rad): {inputs}
   Passive variables: {variables}
   Angular velocities, in ground axes: {poles}
   Largest error, measured between the nodes: {angle_error:.2g} rad of an angle,
   {coefficient_error:.2g} of a coefficient.

   C99, no library but <math.h>. Angles go on without a jump through a cell; cells that a
   jump, a change of assembly mode or the end of one could lie in are not read. */
#ifndef {guard}_COUPLING_H
#define {guard}_COUPLING_H

#include <math.h>

enum {{
    {guard}_INPUTS = {m},
    {guard}_VARIABLES = {k},
    {guard}_POLES = {p},
    {guard}_MODES = {modes},
    {guard}_NODES = {nodes},
    {guard}_CELLS = {cells}
}};

/* What {name}_at returns. */
enum {{ {guard}_OK = 0, {guard}_NO_MODE = 1, {guard}_OUTSIDE = 2, {guard}_NOT_SURE = 3 }};

{enums}
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
static int {name}_at(int mode, const double q[{m}], double angle[{k1}],
                     double coefficient[{k1}][{m}], double derivative[{k1}][{m}][{m}],
                     double turning[{p1}][{m}][3])
{{
    int cell[{m}], number = -1, index = 0;
    double at[{m}], turns[{m}];
    for (int k = 0; k < {modes}; ++k)
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

TURNING = """\
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


def header(table: CouplingTable) -> str:
    """Return the text of a C header with a table and the function that reads it."""
    name = re.sub(r"\W", "_", table.mechanism)
    name = f"m_{name}" if name[0].isdigit() else name
    m, k, p = len(table.inputs), len(table.variables), len(table.poles)
    modes, nodes, cells = len(table.modes), len(table.nodes), table.sure.shape[1]
    sizes = {"m": m, "k": k, "p": p, "name": name}
    arrays = [
        _array(f"double {name}_rise", table.rise),
        _array(f"unsigned char {name}_sure", table.sure.astype(int)),
        _array(f"double {name}_angle", table.angles),
        _array(f"double {name}_coefficient", table.coefficients),
        _array(f"double {name}_derivative", table.derivatives),
    ]
    if p:
        arrays.append(_array(f"double {name}_turning", table.turning))
        arrays.append(
            _array(f"double {name}_turning_derivative", table.turning_derivatives)
        )
    return TEXT.format(
        **sizes,
        mechanism=table.mechanism,
        made_by=table.made_by,
        mechanism_sha256=table.mechanism_sha256,
        inputs=", ".join(table.inputs),
        variables=", ".join(table.variables),
        poles=", ".join(table.poles) or "none",
        angle_error=table.angle_error,
        coefficient_error=table.coefficient_error,
        guard=name.upper(),
        k1=max(k, 1),
        p1=max(p, 1),
        modes=modes,
        nodes=nodes,
        cells=cells,
        enums=_enum(name, (f"{variable}" for variable in table.variables)),
        mode_numbers=_row(table.modes),
        start=_row(table.start),
        step=_row(table.step),
        count=_row(table.count),
        periodic=_row(table.periodic.astype(int)),
        arrays="\n".join(arrays),
        turning_code=TURNING.format(**sizes) if p else "    (void)turning;\n",
    )


def _enum(name: str, words: Iterable[str]) -> str:
    """Return the places of variables in the results, by name."""
    items = [f"{name}_{re.sub(r'[^A-Za-z0-9_]', '_', word)}" for word in words]
    lines = "".join(f"\n    {item} = {k}," for k, item in enumerate(items))
    return (
        f"/* Places of the variables in the results. */\nenum {{{lines.rstrip(',')}\n}};\n"
    )


def _array(head: str, values: Floats) -> str:
    shape = "".join(f"[{size}]" for size in values.shape)
    return f"static const {head}{shape} = {{\n{''.join(_lines(values))}}};"


def _lines(values: Floats) -> Iterator[str]:
    """Yield an array, a line for each node of each mode, with its braces."""
    for mode in values:
        if np.ndim(mode) == 1:
            yield f"  {_braced(mode)},\n"
            continue
        yield "  {\n"
        for node in mode:
            yield f"    {_braced(node)},\n"
        yield "  },\n"


def _braced(values: Floats) -> str:
    if np.ndim(values) == 0:
        return _number(values)
    return "{" + ", ".join(_braced(row) for row in values) + "}"


def _row(values: Iterable[float]) -> str:
    return ", ".join(_number(value) for value in values)


def _number(value: object) -> str:
    """Return a number of C; places without a mode are never read, and zero."""
    if isinstance(value, float | np.floating):
        return repr(float(value)) if np.isfinite(value) else "0.0"
    return str(int(value))  # type: ignore[call-overload]
