r"""Formulas in LaTeX, read back by SymPy and compared with the engine at random inputs.

SymPy's grammar knows neither vectors nor symbols such as ``\mathbf{u}_{31}'``. Before it
reads the right-hand side of a printed formula, and nowhere else, four things are written
otherwise: symbols are numbered, ``x_{1}``; the thin space between factors becomes ``\cdot``
and a product of vectors ``\times`` becomes ``\div``, which stays apart from it in the tree;
functions of one symbol get brackets; and a norm its single bars. The tree is then
evaluated with vectors, in 40 digits.
"""

import functools
import re

import mpmath
import numpy as np
import pytest
import sympy
from sympy.parsing.latex import parse_latex

import spherekit as sk
from spherekit.exchange.latex import latex

ALIGNED = re.compile(r"\\begin\{align\}\n(.*?)\n\\end\{align\}", re.DOTALL)
VALUE = re.compile(r"^\$([^$]+)\$ & .+ & \$([^$]+)\$( \\\\)?$", re.MULTILINE)
SIGN = re.compile(r"^\$(s_\{\d+\})\$ & sign of the triple product of (.*) & ", re.MULTILINE)
POLE = re.compile(
    r"(\\mathbf\{[uw]\}|m)_\{(?:(\d)(\d)|(\d+),(\d+)|(\d+))\}(?:\^\{\((\d)\)\})?"
)


def formulas(text):
    """Return the printed formulas, by left-hand sides."""
    rows = (row for body in ALIGNED.findall(text) for row in body.split(" \\\\\n"))
    return dict(row.split(" &= ") for row in rows)


def scalar(text):
    return mpmath.mpf(re.sub(r"\\cdot 10\^\{(.*)\}", r"e\1", text.strip()))


def rows_of(text):
    """Return what stands in the rows of a column or matrix, None if it is no such."""
    inside = re.fullmatch(r"\\begin\{pmatrix\}(.*)\\end\{pmatrix\}", text)
    return None if inside is None else inside[1].split(r" \\ ")


def values(text):
    """Return the printed values of symbols: angles (rad), vectors and tensors."""
    found = {}
    for symbol, value, _ in VALUE.findall(text):
        if value.startswith("("):
            found[symbol] = mpmath.matrix([scalar(x) for x in value[1:-1].split(",")])
        elif rows_of(value):
            rows = [[scalar(x) for x in row.split("&")] for row in rows_of(value)]
            found[symbol] = mpmath.matrix(rows)
        else:
            found[symbol] = mpmath.radians(scalar(value.removesuffix(r"^{\circ}")))
    return found


@functools.cache
def tree(text):
    """Return what SymPy reads in a text of numbered symbols."""
    text = text.replace(r" \, ", r" \cdot ").replace(r"\times", r"\div")
    text = re.sub(r"\\(sin|cos|arctan) (x_\{\d+\})", r"\\\1\\left(\2\\right)", text)
    return parse_latex(re.sub(r"\\(left|right)\\?\|", "|", text))


def cross(a, b):
    places = (1, 2), (2, 0), (0, 1)
    return mpmath.matrix([a[i] * b[j] - a[j] * b[i] for i, j in places])


def is_finite(x):
    return np.all(np.isfinite(x))


def is_vector(x):
    return isinstance(x, mpmath.matrix)


def evaluated(node, at):
    """Return a tree's value: a number or a vector."""
    if node.is_Symbol:
        return at[node.name]
    if node.is_Number:
        return mpmath.mpf(node.p) / node.q if node.is_Rational else mpmath.mpf(str(node))
    if node.is_Mul:
        made = mpmath.mpf(1)
        for factor in node.args:
            inverse = factor.is_Pow and factor.exp == -1
            part = evaluated(factor.base if inverse else factor, at)
            if is_vector(made) and made.cols == 3:
                made = made * part
            elif is_vector(part):
                both = is_vector(made)
                if both and not inverse:
                    made = (made.T * part)[0]
                else:
                    made = cross(made, part) if both else made * part
            else:
                made = made / part if inverse else made * part
        return made
    parts = [evaluated(x, at) for x in node.args]
    if node.is_Add:
        return functools.reduce(lambda a, b: a + b, parts)
    if node.is_Pow:
        return mpmath.power(*parts)
    if isinstance(node, sympy.Abs) and is_vector(parts[0]):
        return mpmath.norm(parts[0])
    return getattr(mpmath, {"Abs": "fabs"}.get(node.func.__name__, node.func.__name__))(
        *parts
    )


def computed(text, given):
    """Return all symbols of a document with their values, from what it is given."""
    known = {**values(text), **given}
    rows = formulas(text)
    every = sorted({*known, *rows}, key=len, reverse=True)
    symbols = re.compile(
        "|".join(rf"(?<![a-zA-Z\\]){re.escape(x)}(?![a-zA-Z])" for x in every)
    )

    def read(right):
        names = {}
        marked = symbols.sub(
            lambda found: names.setdefault(found[0], f"x_{{{len(names) + 1}}}"), right
        )
        at = {mark: known[symbol] for symbol, mark in names.items()}
        return evaluated(tree(marked), at)

    with mpmath.workdps(40):
        for left, right in rows.items():
            several = rows_of(right)
            parts = [read(part) for part in several or [right]]
            known[left] = mpmath.matrix(parts) if several else parts[0]
    return known


LAWS = sk.Polynomial((0.7, 1.1, -0.4)), sk.Polynomial((1.1, -0.3, 0.5))
TIMES = np.array([0.0, 0.3, 0.7])
LOADS = (
    sk.Gravity("weight", (1.0, -2.0, 9.0)),
    sk.PointForce(
        "push", "5", (0.03, -0.02, 0.1), ("2*cos(theta_35)", "0", "t**2"), "link"
    ),
    sk.Moment("twist", "6", ("0.1", "-0.2*exp(-t)", "abs(sin(theta_34))/3"), "ground"),
    sk.Spring("spring", "35", 0.4, 0.2),
)
RUBBING = ("crankshaft", "driving", "driven", "pin_32", "pin_43")


def shaken(made, rng):
    """Return a mechanism of other sizes, by a few degrees."""
    sizes = made.geometry.links

    def other(numbers):
        return [np.degrees(x) + rng.uniform(-3.0, 3.0) for x in numbers]

    arcs = {link: other(of.arcs) for link, of in sizes.items() if of.arcs}
    angles = {link: other(of.angles) for link, of in sizes.items() if of.angles}
    zeros = {pair.name: rng.uniform(-180.0, 180.0) for pair in made.pairs}
    return made.with_sizes(angle_unit="deg", arcs=arcs, angles=angles, zeros=zeros)


def mechanisms(rng):
    """Yield mechanisms of dyads, without friction that follows from reactions."""
    for name in ("four_bar", "universal_joint", "stephenson", "watt", "five_bar"):
        made = sk.load(name)
        made = made.with_loads(without=[x.name for x in made.loads if x.name in RUBBING])
        yield made
        yield shaken(made, rng)
        if name == "stephenson":
            yield shaken(made.with_loads(*LOADS), rng)
    yield sk.load("eight_bar_12")


def printed_poles(known):
    """Yield what is printed of poles and coefficients, with their names and inputs."""
    for symbol, value in known.items():
        found = POLE.fullmatch(symbol)
        if found:
            kind, *links, moving = found.groups()
            ground = ["1"] if kind == r"\mathbf{w}" else []
            pole = "/".join(filter(None, [*links, *ground]))
            yield symbol, pole, int(moving or 1) - 1, value


def compare(made, text, here, found, row):
    """Hold what a document says at a row against the engine's poles and torques."""
    inputs = here.input_pairs
    one = len(inputs) == 1
    ends = [""] if one else [f"_{{{k + 1}}}" for k in range(len(inputs))]
    given = {"t": mpmath.mpf(TIMES[here.sample[row]])}
    for k, end in enumerate(ends):
        q, dq, ddq = LAWS[k].at(TIMES[[here.sample[row]]])
        for letter, value in zip(("q", r"\dot{q}", r"\ddot{q}"), (q, dq, ddq), strict=True):
            given[letter + end] = mpmath.mpf(value.item())
    for sign, axes in SIGN.findall(text):
        names = ("/".join(filter(None, x[1:5])) for x in POLE.findall(axes))
        triple = [here.direction(name, inputs[0])[row] for name in names]
        given[sign] = int(np.sign(np.linalg.det(triple)))
    known = computed(text, given)
    off = []
    for pair, (a, b) in zip(made.pairs, made.ends, strict=True):
        both = (made.links[b], made.links[a])
        index = "".join(both) if max(map(len, both)) == 1 else ",".join(both)
        if pair.name not in inputs:
            theta = float(known[rf"\theta_{{{index}}}"])
            off.append(np.sin(0.5 * (theta - here.variable(pair.name)[row])))
    for symbol, pole, k, value in printed_poles(known):
        there = here.direction(pole, inputs[k])[row]
        if "^" not in symbol:  # an axis of a pair, which may not move by the first input
            there = next(filter(is_finite, (here.direction(pole, x)[row] for x in inputs)))
        if symbol.startswith("m"):
            velocity = here.velocity_coefficient(pole, inputs[k])[row]
            sense = np.sign(velocity * float(value))
            off.append(float(value) * sense - velocity)
            slope = known.get(f"{symbol}'" if one else f"\\partial_{{{k + 1}}}{symbol}")
            if slope is not None:
                second = here.acceleration_coefficient(pole, inputs[k])[row]
                off.append((float(slope) * sense - second) / (1.0 + abs(second)))
        elif symbol.startswith(r"\mathbf{u}"):
            off += [*np.cross([float(x) for x in value], there)]
        else:
            velocity = here.velocity_coefficient(pole, inputs[k])[row]
            off += [*([float(x) for x in value] - velocity * there)]
    if found is not None:
        for k, end in enumerate(ends):
            torque = found.torques[row, k]
            off.append((float(known[rf"\tau{end}"]) - torque) / (1.0 + abs(torque)))
    return np.max(np.abs(off))


@pytest.mark.parametrize("number", range(12))
def test_printed_formulas_give_what_the_engine_gives(number):
    made = [*mechanisms(np.random.default_rng(number))][number]
    text = latex(made)
    several = len(made.inputs) > 1
    laws = dict(zip(made.input_pairs, LAWS, strict=True)) if several else LAWS[0]
    found = sk.inverse_dynamics(made, laws, TIMES) if made.masses else None
    inputs = np.stack([law.at(TIMES)[0] for law in LAWS], axis=1)
    here = sk.evaluate(made, inputs if several else inputs[:, 0])
    rows = np.flatnonzero(here.status == sk.Status.OK)
    assert len(rows) >= 4
    off = [compare(made, text, here, found, row) for row in rows]
    assert max(off) < 1e-12
