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
from itertools import pairwise
from pathlib import Path

import mpmath
import numpy as np
import pytest
import sympy
from sympy.parsing.latex import parse_latex

import spherekit as sk
from spherekit.exchange.latex import _break_sum, latex
from spherekit.exchange.latex_text import latex_of
from spherekit.symbolic.expression_graph import function, symbols, vector_product

MECHANISMS = Path(__file__).parents[1] / "mechanisms"
ALIGNED = re.compile(r"\\begin\{align\}\n(.*?)\n\\end\{align\}", re.DOTALL)
CONTINUED = " \\nonumber \\\\\n&\\quad {}"
VALUE = re.compile(r"^\$([^$]+)\$ & .+ & \$([^$]+)\$( \\\\)?$", re.MULTILINE)
SIGN = re.compile(r"^\$(s_\{\d+\})\$ & sign of the triple product of (.*) & ", re.MULTILINE)
POLE = re.compile(
    r"(\\mathbf\{[uw]\}|m)_\{(?:(\d)(\d)|(\d+),(\d+)|(\d+))\}(?:\^\{\((\d)\)\})?"
)


def formulas(text):
    """Return the printed formulas, by left-hand sides."""
    rows = (
        row
        for body in ALIGNED.findall(text)
        for row in body.replace(CONTINUED, "").split(" \\\\\n")
    )
    return dict(row.split(" &= ") for row in rows)


def scalar(text):
    return mpmath.mpf(re.sub(r"\\cdot 10\^\{(.*)\}", r"e\1", text.strip()))


def rows_of(text):
    """Return the rows of a printed column or matrix; None if a text is neither."""
    inside = re.fullmatch(r"\\begin\{pmatrix\}(.*)\\end\{pmatrix\}", text)
    return None if inside is None else inside[1].split(r" \\ ")


def printed_values(text):
    """Return the printed values of symbols: angles (rad), vectors and tensors."""
    values = {}
    for symbol, value, _ in VALUE.findall(text):
        if value.startswith("("):
            values[symbol] = mpmath.matrix([scalar(x) for x in value[1:-1].split(",")])
        elif rows_of(value):
            rows = [[scalar(x) for x in row.split("&")] for row in rows_of(value)]
            values[symbol] = mpmath.matrix(rows)
        else:
            values[symbol] = mpmath.radians(scalar(value.removesuffix(r"^{\circ}")))
    return values


@functools.cache
def parse_formula(text):
    """Return the tree that SymPy reads from a formula of numbered symbols."""
    text = text.replace(r" \, ", r" \cdot ").replace(r"\times", r"\div")
    text = re.sub(r"\\(sin|cos|arctan) (x_\{\d+\})", r"\\\1\\left(\2\\right)", text)
    return parse_latex(re.sub(r"\\(left|right)\\?\|", "|", text))


def cross_product(a, b):
    places = (1, 2), (2, 0), (0, 1)
    return mpmath.matrix([a[i] * b[j] - a[j] * b[i] for i, j in places])


def is_finite(x):
    return np.all(np.isfinite(x))


def is_vector(x):
    """Return whether a value is a column of numbers."""
    return isinstance(x, mpmath.matrix) and x.cols == 1


def is_tensor(x):
    """Return whether a value is a 3 x 3 matrix, such as an inertia tensor."""
    return isinstance(x, mpmath.matrix) and x.cols == 3


def evaluate_tree(node, values):
    """Return the value of a formula: a number, a vector or a tensor.

    The formula is a tree that SymPy has read from LaTeX, without simplifying or sorting.

    Parameters
    ----------
    node
        Node of the tree.
    values
        Values of the symbols by name.
    """
    if node.is_Symbol:
        return values[node.name]
    if node.is_Number:
        return mpmath.mpf(node.p) / node.q if node.is_Rational else mpmath.mpf(str(node))
    if node.is_Mul:
        return evaluate_product(node.args, values)
    parts = [evaluate_tree(x, values) for x in node.args]
    if node.is_Add:
        return functools.reduce(lambda a, b: a + b, parts)
    if node.is_Pow:
        return mpmath.power(*parts)
    if isinstance(node, sympy.Abs) and is_vector(parts[0]):
        return mpmath.norm(parts[0])
    # A function, which has the same name in mpmath, except for the absolute value.
    name = node.func.__name__
    function = mpmath.fabs if name == "Abs" else getattr(mpmath, name)
    return function(*parts)


def evaluate_product(factors, values):
    """Return the value of a product of a formula, multiplied from left to right.

    SymPy cannot read vector products. So the cross product a x b was written as a division
    before, which SymPy stores as the factors a and 1 / b, in this order.
    """
    product = mpmath.mpf(1)
    for factor in factors:
        is_divisor = factor.is_Pow and factor.exp == -1
        if is_divisor:
            product = divide_or_cross(product, evaluate_tree(factor.base, values))
        else:
            product = multiply_or_dot(product, evaluate_tree(factor, values))
    return product


def divide_or_cross(a, b):
    """Return a x b of two vectors, and a / b of a vector or a number and a number."""
    if is_vector(a) and is_vector(b):
        return cross_product(a, b)
    return a / b


def multiply_or_dot(a, b):
    """Return the scalar product of two vectors, and a b of a number or tensor a."""
    if is_vector(a) and is_vector(b):
        return (a.T * b)[0]
    return a * b


def evaluate_document(text, given):
    """Return the values of all symbols of a LaTeX document, by symbol, in 40 digits.

    Tests compare these values with independent ones, to check the printed formulas. The
    document prints values of some symbols, and formulas for the others. The formulas are
    evaluated in the order of the document. `given` has the values that are not printed:
    inputs, their rates, time, and the signs that select an assembly mode. A formula that is
    a column vector has one entry per row, and each entry is evaluated by itself.
    """
    with mpmath.workdps(40):
        values = {**printed_values(text), **given}
    formula_of_symbol = formulas(text)
    # Longer symbols first, since a symbol may be the beginning of another.
    sorted_symbols = sorted({*values, *formula_of_symbol}, key=len, reverse=True)
    symbol_pattern = re.compile(
        "|".join(rf"(?<![a-zA-Z\\]){re.escape(x)}(?![a-zA-Z])" for x in sorted_symbols)
    )

    def evaluate_formula(formula):
        """Return the value of a formula, a number or a vector."""
        # SymPy cannot read symbols such as \mathbf{u}_{31}'. They are numbered: x_{1}, ...
        numbered_symbols = {}
        numbered_formula = symbol_pattern.sub(
            lambda match: numbered_symbols.setdefault(
                match[0], f"x_{{{len(numbered_symbols) + 1}}}"
            ),
            formula,
        )
        value_of_number = {
            number: values[symbol] for symbol, number in numbered_symbols.items()
        }
        return evaluate_tree(parse_formula(numbered_formula), value_of_number)

    with mpmath.workdps(40):
        for left_side, right_side in formula_of_symbol.items():
            rows = rows_of(right_side)
            entries = [evaluate_formula(row) for row in rows or [right_side]]
            values[left_side] = mpmath.matrix(entries) if rows else entries[0]
    return values


def plain(vector):
    return np.array([float(x) for x in vector])


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


def with_random_sizes(mechanism, rng):
    """Return a mechanism with slightly different sizes and random zero positions.

    Each arc and angle of a link differs by up to 3 degrees from that of the mechanism. The
    zero position of a pair is where its angle reads 0. `rng` is a random number generator.
    """
    sizes = mechanism.geometry.links

    def changed_sizes_deg(sizes_rad):
        return [np.degrees(x) + rng.uniform(-3.0, 3.0) for x in sizes_rad]

    arcs = {
        link: changed_sizes_deg(link_sizes.arcs)
        for link, link_sizes in sizes.items()
        if link_sizes.arcs
    }
    angles = {
        link: changed_sizes_deg(link_sizes.angles)
        for link, link_sizes in sizes.items()
        if link_sizes.angles
    }
    zeros = {pair.name: rng.uniform(-180.0, 180.0) for pair in mechanism.pairs}
    return mechanism.with_sizes(angle_unit="deg", arcs=arcs, angles=angles, zeros=zeros)


def mechanisms(rng):
    """Yield mechanisms of dyads, without friction that follows from reactions."""
    for name in ("four_bar", "universal_joint", "stephenson", "watt", "five_bar"):
        mechanism = sk.load(name)
        mechanism = mechanism.with_loads(
            without=[x.name for x in mechanism.loads if x.name in RUBBING]
        )
        yield mechanism
        yield with_random_sizes(mechanism, rng)
        if name == "stephenson":
            yield with_random_sizes(mechanism.with_loads(*LOADS), rng)
    yield sk.load("eight_bar_12")


def printed_poles(values):
    """Yield symbol, name of the pole, index of the moving input, and value of what is
    printed.
    """
    for symbol, value in values.items():
        match = POLE.fullmatch(symbol)
        if match:
            kind, *links, moving = match.groups()
            ground = ["1"] if kind == r"\mathbf{w}" else []
            pole = "/".join(filter(None, [*links, *ground]))
            yield symbol, pole, int(moving or 1) - 1, value


def largest_deviation(mechanism, text, evaluation, dynamics, row):
    """Return the largest deviation of a document's values from the engine's, at one row.

    Angles of pairs, poles, coefficients and their derivatives, and torques are compared. A
    pole and its coefficient may change sign together. The printed symbols are

    - ``\\theta_{ji}``: the angle of a pair,
    - ``\\mathbf{u}_{ji}``: the axis of a pole, a unit vector. Without an exponent it is the
      axis of a pair; the exponent ``(k)`` is the number of the moving input,
    - ``m_{ji}``: the velocity coefficient of a pole,
    - ``\\mathbf{w}_{j}``: the angular velocity of a link.

    Parameters
    ----------
    mechanism, text
        The mechanism and its document.
    evaluation, dynamics
        The results of the engine; `dynamics` is None without masses.
    row
        The row that is compared.
    """
    inputs = evaluation.input_pairs
    has_one_input = len(inputs) == 1
    ends = [""] if has_one_input else [f"_{{{k + 1}}}" for k in range(len(inputs))]
    given = {"t": mpmath.mpf(TIMES[evaluation.sample[row]])}
    for k, end in enumerate(ends):
        q, dq, ddq = LAWS[k].at(TIMES[[evaluation.sample[row]]])
        for letter, value in zip(("q", r"\dot{q}", r"\ddot{q}"), (q, dq, ddq), strict=True):
            given[letter + end] = mpmath.mpf(value.item())
    # The document defines the sign of a dyad as that of the triple product of three pole
    # axes. Groups 1 to 4 of a match are the two links of a pole, in one of two spellings.
    for sign, axes in SIGN.findall(text):
        names = ("/".join(filter(None, x[1:5])) for x in POLE.findall(axes))
        triple = [evaluation.direction(name, inputs[0])[row] for name in names]
        given[sign] = int(np.sign(np.linalg.det(triple)))
    values = evaluate_document(text, given)
    deviations = []
    for pair, (a, b) in zip(mechanism.pairs, mechanism.ends, strict=True):
        pair_links = (mechanism.links[b], mechanism.links[a])
        index = (
            "".join(pair_links) if max(map(len, pair_links)) == 1 else ",".join(pair_links)
        )
        if pair.name not in inputs:
            theta = float(values[rf"\theta_{{{index}}}"])
            deviations.append(np.sin(0.5 * (theta - evaluation.variable(pair.name)[row])))
    for symbol, pole, k, value in printed_poles(values):
        pole_axis = evaluation.direction(pole, inputs[k])[row]
        # The axis of a pair is printed without an input. It is NaN in the results of inputs
        # that do not move the pair, so the first input that does is taken.
        if "^" not in symbol:
            pole_axis = next(
                filter(is_finite, (evaluation.direction(pole, x)[row] for x in inputs))
            )
        if symbol.startswith("m"):
            velocity = evaluation.velocity_coefficient(pole, inputs[k])[row]
            sense = np.sign(velocity * float(value))
            deviations.append(float(value) * sense - velocity)
            slope = values.get(
                f"{symbol}'" if has_one_input else f"\\partial_{{{k + 1}}}{symbol}"
            )
            if slope is not None:
                acceleration = evaluation.acceleration_coefficient(pole, inputs[k])[row]
                deviations.append(
                    (float(slope) * sense - acceleration) / (1.0 + abs(acceleration))
                )
        elif symbol.startswith(r"\mathbf{u}"):
            deviations += [*np.cross([float(x) for x in value], pole_axis)]
        else:
            velocity = evaluation.velocity_coefficient(pole, inputs[k])[row]
            deviations += [*([float(x) for x in value] - velocity * pole_axis)]
    if dynamics is not None:
        for k, end in enumerate(ends):
            torque = dynamics.torques[row, k]
            deviations.append((float(values[rf"\tau{end}"]) - torque) / (1.0 + abs(torque)))
    return np.max(np.abs(deviations))


@pytest.mark.slow
@pytest.mark.many
@pytest.mark.parametrize("number", range(12))
def test_printed_formulas_give_what_the_engine_gives(number):
    """Formulas printed in LaTeX, evaluated in 40 digits, give the numbers of the engine.

    SymPy reads the formulas. The mechanisms (`mechanisms`) have one or two inputs and
    consist of dyads (two links each). `number` selects one of them and is the seed of
    random sizes. `largest_deviation` compares angles of pairs, poles (axes of relative
    rotation), their velocity coefficients and derivatives, and torques.
    """
    all_mechanisms = list(mechanisms(np.random.default_rng(number)))
    mechanism = all_mechanisms[number]
    text = latex(mechanism)
    has_several_inputs = len(mechanism.inputs) > 1
    laws = (
        dict(zip(mechanism.input_pairs, LAWS, strict=True))
        if has_several_inputs
        else LAWS[0]
    )
    dynamics = sk.inverse_dynamics(mechanism, laws, TIMES) if mechanism.masses else None
    # (times, 2) input angles by both laws. A single input follows the first one.
    columns = []
    for law in LAWS:
        angles, _rates, _accelerations = law.at(TIMES)
        columns.append(angles)
    inputs = np.stack(columns, axis=1)
    evaluation = sk.evaluate(mechanism, inputs if has_several_inputs else inputs[:, 0])
    rows = np.flatnonzero(evaluation.status == sk.Status.OK)
    # There is a row for each of the three times and each assembly mode. Some may be out of
    # reach, but at least four must be compared.
    assert len(rows) >= 4
    deviations = [
        largest_deviation(mechanism, text, evaluation, dynamics, row) for row in rows
    ]
    assert max(deviations) < 1e-12


def four_bar_of_the_paper(q, p):
    """Return the quantities of the four-bar in a paper, eqs. (15) and (22)-(26).

    The paper is R. Di Gregorio, Mechanism and Machine Theory, 2024, 105720 (the source of
    the shipped four-bar). The names of variables follow it.

    Parameters
    ----------
    q
        The input (rad), the angle of link 2 relative to link 1.
    p
        The assembly mode, 0 or 1: the exponent in the sign of the root.

    Returns
    -------
    Angle theta_41 (rad), unit vectors and velocity coefficients by their names, and the
    parts of the effective inertia of links 2, 3 and 4. A part is the squared velocity
    coefficient times the moment of inertia about the axis of the link's rotation.
    """
    # Arcs of the links 1 to 4: 60, 20, 70 and 40 degrees.
    a1, a2, a3, a4 = (mpmath.pi / x for x in (3, 9, mpmath.mpf(18) / 7, mpmath.mpf(9) / 2))
    sin, cos = mpmath.sin, mpmath.cos
    i1, j1, k1 = (mpmath.matrix(row) for row in np.eye(3).tolist())
    # The coefficients of the closure equation, and its root theta_41.
    c0 = cos(a4) * (cos(q) * sin(a2) * sin(a1) + cos(a1) * cos(a2)) - cos(a3)
    c1 = sin(q) * sin(a2) * sin(a4)
    c2 = sin(a4) * (cos(q) * sin(a2) * cos(a1) - sin(a1) * cos(a2))
    root = mpmath.sqrt(c1**2 + c2**2 - c0**2)
    theta = 2 * mpmath.atan2(-c1 + (-1) ** p * root, c0 - c2)
    u41, u21 = k1, sin(a1) * j1 + cos(a1) * k1
    j2 = sin(q) * i1 + cos(q) * (sin(a1) * k1 - cos(a1) * j1)
    u32 = cos(a2) * u21 + sin(a2) * j2
    u43 = cos(a4) * k1 + sin(a4) * (sin(theta) * i1 - cos(theta) * j1)
    i3, i4 = cross_product(u43, u32) / sin(a3), cross_product(u41, u43) / sin(a4)
    poles = (
        cross_product(cross_product(u41, u43), cross_product(u21, u32)),
        cross_product(cross_product(u21, u41), cross_product(u32, u43)),
    )
    u31, u42 = (pole / mpmath.norm(pole) for pole in poles)
    dot = mpmath.fdot
    m3, m4 = (
        dot(cross_product(u, u21), cross_product(v, u21))
        / dot(cross_product(u, u21), cross_product(v, u))
        for u, v in ((u31, u32), (u41, u42))
    )
    frames = (
        (cross_product(j2, u21), j2, u21),
        (i3, cross_product(u32, i3), u32),
        (i4, cross_product(u43, i4), u43),
    )
    masses = {mass.link: mpmath.matrix(mass.tensor) for mass in sk.load("four_bar").masses}
    parts = []
    for frame, m, u, tensor in zip(
        frames, (1, m3, m4), (u21, u31, u41), masses.values(), strict=True
    ):
        # The axis of rotation in the axes of the link, as the inertia tensor is.
        axis_in_link = mpmath.matrix([dot(axis, u) for axis in frame])
        parts.append(m**2 * dot(axis_in_link, tensor * axis_in_link))
    vectors = {"u_{32}": u32, "u_{43}": u43, "u_{31}": u31, "u_{42}": u42, "i_{3}": i3}
    vectors |= {"i_{4}": i4, "t^{2}_{21}": j2, "j_{3}": frames[1][1], "j_{4}": frames[2][1]}
    return theta, vectors, {"m_{31}": m3, "m_{41}": m4}, parts


@pytest.mark.parametrize("p", [0, 1])
def test_the_four_bar_of_the_paper_term_by_term(p):
    """Each printed quantity of the four-bar has the value of the formula in its source.

    The source is Di Gregorio 2024 (`four_bar_of_the_paper`), with an assembly mode for each
    exponent p. `evaluate_document` evaluates the formulas printed in LaTeX in 40 digits.
    Derivatives of the source are numerical. The torque is that of Eksergian's equation. The
    loads are those of the shipped file: torques -sin(q) and -5 sin(theta_41), and viscous
    friction of 2 N m s/rad, at the pairs 21 and 41.

    Two signs differ by convention. The document selects the mode p by the sign s_1 =
    -(-1)^p. It has the unit vector u_31 on the pole axis of links 3 and 1 in the opposite
    sense, and so the opposite sign of the coefficient m_31.
    """
    text = latex(sk.load("four_bar"))
    q, dq, ddq = map(mpmath.mpf, ("0.9", "1.3", "-0.7"))
    sign_of_mode = -((-1) ** p)
    given = {"q": q, r"\dot{q}": dq, r"\ddot{q}": ddq, "s_{1}": sign_of_mode}
    known = evaluate_document(text, given)
    with mpmath.workdps(40):
        theta, vectors, ratios, parts = four_bar_of_the_paper(q, p)
        assert abs(mpmath.sin((theta - known[r"\theta_{41}"]) / 2)) < 1e-15
        for name, vector in vectors.items():
            if name == "u_{31}":
                expected = -vector
            else:
                expected = vector
            # The document sets vectors in bold: the name u_{31} is there \mathbf{u}_{31}.
            letter = name[0]
            indices = name[1:]
            printed = known[rf"\mathbf{{{letter}}}{indices}"]
            assert mpmath.norm(expected - printed) < 1e-15
        # The sum is zero because the signs of m_31 are opposite.
        assert abs(ratios["m_{31}"] + known["m_{31}"]) < 1e-15
        assert abs(ratios["m_{41}"] - known["m_{41}"]) < 1e-15

        # This formula of the paper is differentiated numerically at the input angle q.
        def ratio_of_the_paper(angle, name):
            _, _, ratios, _ = four_bar_of_the_paper(angle, p)
            return ratios[name]

        slope_31 = mpmath.diff(lambda angle: ratio_of_the_paper(angle, "m_{31}"), q)
        slope_41 = mpmath.diff(lambda angle: ratio_of_the_paper(angle, "m_{41}"), q)
        assert abs(slope_31 + known["m_{31}'"]) < 1e-12
        assert abs(slope_41 - known["m_{41}'"]) < 1e-12

        def inertia_of_the_paper(angle):
            """Return the parts of the effective inertia of links 2, 3 and 4."""
            _, _, _, inertia_parts = four_bar_of_the_paper(angle, p)
            return inertia_parts

        # A part is x^T I x, with the inertia tensor I of the link and its angular velocity
        # x per rate of the input, both in axes of the link.
        for k, part in enumerate(parts):
            link = k + 2
            tensor = known[rf"\mathbf{{I}}_{{{link}}}"]
            x = known[rf"\mathbf{{x}}_{{{link}}}"]
            assert abs(part - (x.T * tensor * x)[0]) < 1e-15
            # The derivative of x by the input. It is not printed if it is zero.
            x_derivative = known.get(rf"\mathbf{{x}}_{{{link}}}'", 0 * x)
            rate = mpmath.diff(lambda angle, k=k: inertia_of_the_paper(angle)[k], q)
            assert abs(rate - 2 * (x_derivative.T * tensor * x)[0]) < 1e-12
        slope = mpmath.diff(lambda angle: sum(inertia_of_the_paper(angle)), q)
        m4 = ratios["m_{41}"]
        loads = -mpmath.sin(q) - 2 * dq + m4 * (-5 * mpmath.sin(theta) - 2 * m4 * dq)
        torque = sum(parts) * ddq + slope * dq**2 / 2 - loads
        assert abs(torque - known[r"\tau"]) < 1e-12


def test_only_what_is_asked_for_is_printed():
    """A document for one quantity has those of the formulas that it needs, in the same
    words.
    """
    made = sk.load("stephenson")
    whole, few = (formulas(latex(made, x)) for x in (None, ["velocity_coefficient_4_1"]))
    assert len(few) < 0.3 * len(whole) and set(few.items()) <= set(whole.items())
    assert list(few)[-1] == "m_{41}" and not any("theta" in x for x in few)
    assert "crankshaft depends on reactions" in latex(made, ["torque"])
    assert r"\psi_{2}" in formulas(latex(made, ["transmission_angle_56"]))


def test_sizes_that_vary_stay_symbols():
    """Sizes named in `vary` remain symbols in the printed formulas.

    With other values for the arcs of links 3 and 4, the formulas must give an angle of the
    mechanism with these arcs.

    If an element of an inertia tensor varies, the whole tensor is a symbol. A mechanism
    with loads refuses this. Loads such as gravity depend on the mass, and the formulas have
    the mass as a number.
    """
    mechanism = sk.load("universal_joint")
    keys = ["links.3.arc", "links.4.arc", "mass.3.tensor.0.0"]
    with pytest.raises(sk.SpherekitError, match="not a symbol"):
        latex(mechanism, vary=keys)
    unloaded = mechanism.with_loads(without=[load.name for load in mechanism.loads])
    text = latex(unloaded, vary=keys)
    assert r"\cos \alpha_{3}" in text
    assert r"\cos \alpha_{2}" not in text
    assert r"$\mathbf{I}_{3}$ & inertia tensor of link 3 (kg m$^2$), free" in text

    changed = unloaded.with_sizes(angle_unit="deg", arcs={"3": 80.0, "4": 75.0})
    inserted_values = {
        "q": mpmath.mpf("0.4"),
        r"\dot{q}": 0,
        r"\ddot{q}": 1,
        r"\alpha_{3}": mpmath.radians(80),
        r"\alpha_{4}": mpmath.radians(75),
        # The sign selects one of the two assembly modes.
        "s_{1}": -1,
    }
    values = evaluate_document(text, inserted_values)
    # `evaluate` returns the angles of both assembly modes. One of them has this sign.
    expected_angles = sk.evaluate(changed, 0.4).variable("41")
    differences = np.abs(expected_angles - float(values[r"\theta_{41}"]))
    assert np.min(differences) < 1e-12


@pytest.mark.parametrize(
    ("made", "quantities", "told"),
    [
        (sk.load("two_dof_spm"), None, "the triad of links"),
        (sk.load("roller_cam"), None, "contact group of 2 bodies of links follower"),
        (sk.load("four_bar"), ["tork"], 'did you mean "torque"'),
        (sk.load("four_bar").with_inputs("32"), None, "inputs.32: formulas are printed"),
    ],
)
def test_what_has_no_formula_is_refused_by_name(made, quantities, told):
    with pytest.raises(sk.SpherekitError, match=told):
        latex(made, quantities)


def test_components_have_the_names_of_row_quantities():
    """The name of a component stands for its vector; a number has no components."""
    five_bar = sk.load("five_bar")
    assert latex(five_bar, ["pole_3_1_x_by_21"]) == latex(five_bar, ["pole_3_1_by_21"])
    assert latex(five_bar, ["orientation_3_xy"]) == latex(five_bar, ["orientation_3"])
    for name in ("torque_41", "theta_41_rate", "pole_3_1_q", "orientation_3_x"):
        with pytest.raises(sk.SpherekitError, match=f'"{name}" cannot be exported'):
            latex(sk.load("four_bar"), [name])


def renamed(name, folder, names):
    """Return a shipped mechanism with other names of links."""
    lines = (MECHANISMS / f"{name}.toml").read_text().splitlines()
    for index, line in enumerate(lines):
        if line.startswith(("ground =", "link", "relative_to =", "[links.", "[mass.")):
            lines[index] = re.sub(r"\w+", lambda word: names.get(word[0], word[0]), line)
    path = folder / "renamed.toml"
    path.write_text("\n".join(lines))
    return sk.load(path)


def test_no_symbol_has_two_formulas(tmp_path):
    """Link 21 and the pair of links 2 and 1 have different symbols."""
    zeros = {"21": 20.0}
    usual = sk.load("five_bar").with_sizes(angle_unit="deg", zeros=zeros)
    mechanism = renamed("five_bar", tmp_path, {"3": "21"})
    printed = formulas(latex(mechanism.with_sizes(angle_unit="deg", zeros=zeros)))
    assert len(printed) == len(formulas(latex(usual)))
    assert r"\mathbf{A}_{21}" not in printed[r"\mathbf{z}_{21}"]


def test_coefficients_of_pairs_do_not_depend_on_names(tmp_path):
    """The links "a_b", "c" and the links "a", "b_c" join to the same text."""
    mechanism = renamed("four_bar", tmp_path, {"1": "c", "2": "a_b", "3": "a", "4": "b_c"})
    torque, usual = (latex(x, ["torque"]) for x in (mechanism, sk.load("four_bar")))
    assert formulas(torque) == formulas(usual)


def test_a_name_of_two_quantities_stands_for_both(tmp_path):
    mechanism = renamed("four_bar", tmp_path, {"1": "c", "2": "a", "3": "b_c", "4": "a_b"})
    printed = formulas(latex(mechanism, ["velocity_coefficient_a_b_c"]))
    assert {"m_{23}", "m_{41}"} <= {*printed}


def test_all_links_and_omitted_loads_are_listed(tmp_path):
    """The document lists all 14 links and all 19 omitted loads.

    The formulas omit the friction of bearings, because it depends on reactions in pairs. A
    long list must not be cut and end with, for example, "and 5 more".
    """
    text = (MECHANISMS / "twelve_bar.toml").read_text()
    names = ["2", "p13", "q14", "11"]  # another dyad, between the links 2 and 11
    text += "[links.p13]\n[links.q14]\n"
    for number, (first_link, second_link) in enumerate(pairwise(names)):
        text += f'[pairs.n{number}]\ntype = "R"\n'
        text += f'links = ["{first_link}", "{second_link}"]\n'
        # Longitude and latitude (deg) of the axis. Other axes would do as well.
        text += f"lonlat = [{20.0 * number}, {30.0 - 25.0 * number * number}]\n"
    path = tmp_path / "fourteen.toml"
    path.write_text(text)
    mechanism = sk.load(path)
    # Every pair has two bearings with friction: their positions along the axis (m), their
    # radius (m) and the coefficient of friction. The values have no influence on the lists.
    bearings = [
        sk.Bearings(f"b{pair.name}", pair.name, (0.1, 0.2), 0.01, 0.1)
        for pair in mechanism.pairs
    ]
    text = latex(mechanism.with_loads(*bearings), ["torque"])
    # Both lists are there up to their last entries.
    assert "13 is p13, 14 is q14; the first is the ground" in text
    assert "bn2 depends on reactions" in text
    # No list was cut.
    assert "more" not in text


def test_long_sums_break_between_summands():
    """A row ends before a summand that does not fit, not within it or before the first."""
    torque = " + ".join(f"({k} + sin({k}*t)*cos({k}*theta_21))" for k in range(100, 112))
    load = sk.PairTorque("long", "21", f"t*({torque})*exp(t)")
    mechanism = sk.load("four_bar").with_loads(load)
    assert r"&= \nonumber" not in latex(mechanism)
    summand = r"\left(" + "a" * 100 + " + " + "b" * 100 + r"\right)"
    assert _break_sum(f"{'c' * 100} - {summand}") == f"{'c' * 100}{CONTINUED} - {summand}"
    assert _break_sum("a" * 300 + " + b") == "a" * 300 + f"{CONTINUED} + b"


def test_only_negatives_of_symbols_are_inserted():
    """The formula of a torque -1 + theta_41 is printed, as that of -2 + theta_41."""
    mechanism = sk.load("four_bar").with_loads(sk.PairTorque("p", "41", "-1 + theta_41"))
    assert formulas(latex(mechanism))["T_{3}"] == r"-1 + \theta_{41}"


def test_brackets_follow_from_what_an_expression_is():
    """LaTeX of expressions has brackets where they are needed.

    An exponent belongs to the whole base, and a vector product as a factor is bracketed.
    `texts` has expressions by their expected text.
    """
    a, b, c, u, v, w = symbols(
        ["a", "b", "c^{(1)}", r"\mathbf{u}", r"\mathbf{v}", r"\mathbf{w}"]
    )
    sine = function("sin", a)
    scaled = vector_product("cross", u, a * v)
    texts = {
        r"a^{2}": a * a,
        r"\left(c^{(1)}\right)^{2}": c * c,
        r"\left(\sin a\right)^{2}": sine * sine,
        r"\left(\frac{a}{b}\right)^{2}": (a / b) * (a / b),
        r"\sin\left(\frac{a}{b}\right)": function("sin", a / b),
        r"a - 2 \, b": a + -2.0 * b,
        r"b \, \left(\mathbf{u} \times \left(a \, \mathbf{v}\right)\right)": b * scaled,
    }
    assert {latex_of(expression): expression for expression in texts.values()} == texts
    assert latex_of(w * b) == r"b \, \mathbf{w}"
