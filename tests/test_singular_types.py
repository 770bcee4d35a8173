"""Types of outputs against the kernel of the loops, made from pair axes alone."""

from dataclasses import replace

import numpy as np
import pytest
from mechanism_examples.linkages import (
    choose_random_inputs,
    mechanism_from_chain,
    parse_chain,
    random_axes,
    random_chain,
)
from mechanism_examples.named_mechanisms import four_bar
from mechanism_examples.shipped_mechanisms import load_without_loads
from scipy.linalg import null_space
from scipy.spatial.transform import Rotation

import spherekit as sk
from spherekit.mechanism.elements import Input, Output
from spherekit.outputs.pose_solver import output_kinematics
from spherekit.positions.motion import make_motion
from spherekit.singularities.curve_starts import (
    closed_configurations,
    is_singular_everywhere,
    points_from,
)
from spherekit.singularities.several_inputs import coefficients, what_vanishes
from spherekit.singularities.singularity_report import SingularityReport
from spherekit.singularities.slices import solver_of
from spherekit.singularities.stationarity import output_of
from spherekit.tolerances import SINGULAR_TRANSMISSION
from spherekit.velocities.transmission_measure import Transmission

NAME = "singularities"
FIVE = parse_chain("1-2 2-3 3-4 4-5 1-5")
RANK = 1e-7


def rank(matrix):
    return np.sum(np.linalg.svd(matrix, compute_uv=False) > RANK) if matrix.size else 0


def kernel_type(made, values, output):
    """Return the type of a configuration (V,): which motions the links' rates allow.

    Unknown are the angular velocities of all links but the first and the rates of all R
    pairs, whose axes join them; no loop and no tree is chosen.
    """
    at = solver_of(made).closure.at(values[None])
    links, pairs = len(made.links), len(made.pairs)
    equations = np.zeros((3 * pairs, 3 * links + pairs))
    for k, (a, b) in enumerate(made.ends):
        rows = slice(3 * k, 3 * k + 3)
        equations[rows, 3 * a : 3 * a + 3] -= np.eye(3)
        equations[rows, 3 * b : 3 * b + 3] += np.eye(3)
        equations[rows, 3 * links + k] = -at.axes[0, k]
    motions = null_space(equations[:, 3:], rcond=1e-9)
    w = np.concatenate([np.zeros((3, motions.shape[1])), motions])
    o, s = (made.link_number[name] for name in (output.link, output.relative_to))
    turning = w[3 * o : 3 * o + 3] - w[3 * s : 3 * s + 3]
    freedoms = 3
    if output.direction is not None and len(made.inputs) == 2:
        direction = at.rotations[0, o] @ np.array(output.direction)
        turning = turning - np.outer(direction, direction @ turning)
        freedoms = 2
    driven = [made.pair_number[item.pair] for item in made.inputs]
    inputs = w[3 * links :][driven]
    count = motions.shape[1]
    both = count - rank(np.concatenate([inputs, turning]))
    idle = max(min(count - both, len(driven)) - freedoms, 0)
    crossed = count > len(driven)
    held = crossed or count - rank(turning) - both == idle
    if count - rank(inputs) != both:
        return "II" if held else "III"
    if not held:
        return "I"
    return "self-motion" if both or crossed else "regular"


def of_rows(frame, made):
    """Return the configurations (n, V) that rows of the table name."""
    several = len(made.inputs) > 1
    driven = {f"theta_{x.pair}": f"q_{x.pair}" if several else "q" for x in made.inputs}
    return frame[[driven.get(name, name) for name in made.variable_names]].to_numpy()


def posed(edges, driven, *outputs, axes=None, span=1.0):
    """Return a chain in a pose, with inputs and with outputs (link, relative to)."""
    if axes is None:
        axes = random_axes(np.random.default_rng(2), len(edges))
    return declared(mechanism_from_chain(edges, axes), driven, outputs, span)


def declared(made, driven, outputs, span=1.0):
    """Return a mechanism with inputs and with outputs (link, relative to, direction)."""
    named = tuple(
        Output(f"out{k}", str(a), str(b), direction)
        for k, (a, b, direction) in enumerate(outputs)
    )
    return replace(made, inputs=tuple(Input(x, -span, span) for x in driven), outputs=named)


AHEAD = (0.0, 0.6, 0.8)
PASSIVE = posed([*FIVE, *parse_chain("1-6 6-7 7-3")], ["p1_2", "p1_5"], (3, 1, AHEAD))
CRANK = posed(FIVE, ["p1_2", "p1_5"], (2, 1, None), (3, 1, AHEAD))
RELATIVE = posed(FIVE, ["p1_2", "p1_5"], (2, 5, None))
ONE_LEG = posed(FIVE, ["p1_2", "p2_3"], (3, 1, AHEAD))
DRIVEN = posed(
    [*FIVE, *parse_chain("1-6 6-7 7-2")], ["p1_6", "p1_5"], (7, 1, None), (3, 1, AHEAD)
)


@pytest.mark.many
@pytest.mark.parametrize(
    ("made", "expected"),
    [
        pytest.param(
            PASSIVE, {"3/1": {"I", "II", "III", "self-motion"}}, marks=pytest.mark.slow
        ),
        (CRANK, {"2/1": {"I", "self-motion"}, "3/1": {"I", "II", "III"}}),
        (RELATIVE, {"2/5": {"self-motion"}}),
        (ONE_LEG, {"3/1": {"I", "self-motion"}}),
        (DRIVEN, {"7/1": {"I", "III", "self-motion"}, "3/1": {"I", "II", "III"}}),
    ],
    ids=["passive leg", "crank", "crank to crank", "one leg", "driven by a four-bar"],
)
def test_a_row_is_what_the_links_can_do_there(made, expected):
    """The row alone names its configuration; its type is that of the output."""
    result = sk.run(made, f"{NAME}:input_grid=0,slices=1", samples=3)
    frame = result.frame(NAME)
    for name, kinds in expected.items():
        rows = frame[frame.output == name]
        assert set(rows.kind) <= kinds
        always = rows[rows.note == "in every configuration"]
        assert len(always) == (name in ("2/1", "7/1"))
        rows = rows.drop(always.index)
        assert set(rows.kind) >= kinds - {"I", "II", "III"}
        (output,) = (o for o in made.outputs if f"{o.link}/{o.relative_to}" == name)
        values = of_rows(rows, made)
        assert (
            np.max(solver_of(made).closure.at(values).closure_residual, initial=0.0) < 1e-12
        )
        step = 1 + len(rows) // 60
        for kind, here in zip(rows.kind[::step], values[::step], strict=True):
            assert kernel_type(made, here, output) == kind
    remarks = " ".join(result.summary["remarks"])
    assert "stopped after" not in remarks


@pytest.mark.slow
def test_two_outputs_of_the_same_links_have_their_names_in_every_table():
    made = posed(FIVE, ["p1_2", "p1_5"], (3, 1, AHEAD), (3, 1, None))
    result = sk.run(made, f"{NAME}:input_grid=0,slices=1", samples=3)
    assert set(result.frame(NAME, "relation").output) == {"3/1 out0", "3/1 out1"}
    assert set(result.frame(NAME).output) <= {"3/1 out0", "3/1 out1"}
    (analysis,) = result.summary["analyses"]
    assert {"3/1 out0", "3/1 out1"} <= set(analysis["findings"])


def test_one_input_has_the_same_name_for_what_moves_neither():
    """The crank as its own output: neither moves where coupler and follower are in line."""
    made = four_bar(np.radians([100.0, 50.0, 70.0, 40.0]))
    frame = sk.run(made, f"{NAME}:output=2/1", samples=9).frame(NAME)
    assert len(frame) and set(frame.kind) == {"self-motion"}
    own = Output("crank", "2", "1")
    for here in of_rows(frame, made):
        assert kernel_type(made, here, own) == "self-motion"


def test_no_note_takes_an_output_for_the_input():
    """Stephenson's with a short last link: its dyad stretches, and the crank waits."""
    made = load_without_loads("stephenson").with_sizes(angle_unit="rad", arcs={"6": 0.5})
    frame = sk.run(made, f"{NAME}:output=2/3", samples=9).frame(NAME)
    rows = frame[frame.kind == "self-motion"]
    assert len(rows) and rows.note.str.contains("stand still together").all()
    assert not frame.note.str.contains("the output is the input").any()


@pytest.mark.parametrize("name", ["three_rrr", "agile_eye"])
def test_axes_that_coincide_are_not_called_coplanar(name):
    """Theorem 2 of Di Gregorio (2015): all u_i coincide at type II of three inputs."""
    made = sk.load(name)
    view = SingularityReport.for_output(solver_of(made), output_of(made), "II")
    values = closed_configurations(view.solver, 16, np.random.default_rng(5))
    points = points_from(view.locus, values, view.solver.driven)
    words = what_vanishes(make_motion(view.solver, points.values), view.output)
    assert name == "agile_eye" or len(words)
    for text in words:
        assert "coincide" in text and "coplanar" not in text


def drawn(number):
    """Return a random mechanism: a chain, passive and coupled legs, any pairs driven."""
    random = np.random.default_rng(number)
    freedoms = 3 if number % 5 == 4 else 2
    kind = number % 3
    if freedoms == 3:
        edges = parse_chain("1-2 2-3 3-4 1-5 5-6 6-4 1-7 7-8 8-4")
    elif kind == 0:
        edges = random_chain(random, 7, freedoms)
    else:
        edges = list(FIVE)
    if kind == 1:
        a, b = random.choice(range(1, 6), 2, replace=False)
        edges += [(int(a), 11), (11, 12), (12, int(b))]
    if kind == 2 and freedoms == 2:
        edges += parse_chain("1-11 11-12 12-2")
    made = choose_random_inputs(
        random, mechanism_from_chain(edges, random_axes(random, len(edges))), freedoms
    )
    assert made is not None
    links = [random.choice(made.links, 2, replace=False) for _ in range(2)]
    links.append(made.pairs[made.pair_number[made.inputs[0].pair]].links)
    directions = (None if freedoms == 3 else AHEAD, None, None)
    outputs = [(*two, way) for two, way in zip(links, directions, strict=True)]
    return declared(made, made.input_pairs, outputs)


def closed(solver, count):
    """Return configurations (n, V) not far from where all variables are zero."""
    random = np.random.default_rng(1)
    starts = random.uniform(-0.8, 0.8, (2 * count, len(solver.closure.tree.owners)))
    if solver.reference is None:
        return closed_configurations(solver, 4 * count, random)[:count]
    starts[0] = 0.0
    solution = solver.closure.solve(starts, list(solver.driven), max_steps=40)
    return solution.values[solution.closure_residual < 1e-12][:count]


def check_types(made, count):
    """Compare what is said of rows and of loci with the kernel; return the types met."""
    solver = solver_of(made)
    met = []
    for output in made.outputs:
        rest = output_of(made, output.name)
        rest = replace(rest, pointing=None if len(made.inputs) > 2 else output.direction)
        views = {
            kind: SingularityReport.for_output(solver, rest, kind)
            for kind in ("II", "I", "self-motion")
        }
        values = closed(solver, count)
        rows = [values[:6]]
        for kind, view in views.items():
            if is_singular_everywhere(view):
                assert kernel_type(made, values[0], output) == kind
                continue
            points = points_from(view.locus, values, solver.driven).values
            rows.append(points[:8])
            if kind == "II":
                assert np.all(view.has_type(view.types(points)))
        rows = np.concatenate(rows)
        told = coefficients(make_motion(solver, rows), rest)
        measure = Transmission.from_mechanism(made, output).measure_configurations(
            solver.closure, rows
        )
        assert np.max(np.abs(told.type_two - measure)) < 1e-12
        whole = views["II"].locus
        for k, here in enumerate(rows):
            kind = kernel_type(made, here, output)
            clear = min(told.type_two[k], told.type_one[k], told.hold[k])
            if SINGULAR_TRANSMISSION < 1e3 * clear < 1.0:
                continue  # near a type, or where two loci meet
            assert views["II"].types(here[None])[0] == told.type[k]
            assert kind == {0: "regular", 4: "self-motion"}.get(
                int(told.type[k]), "I" * int(told.type[k])
            )
            if kind in ("II", "III"):
                measure = whole.measure(whole.tangent_space(here[None]))
                assert measure.smallest_singular_value[0] < RANK
            met.append(kind)
    return met


LONG = pytest.param(range(12, 200), marks=pytest.mark.long)


@pytest.mark.slow
@pytest.mark.many
@pytest.mark.parametrize("numbers", [range(0, 4), range(4, 12), LONG])
def test_random_mechanisms_by_the_kernel(numbers):
    met = [kind for number in numbers for kind in check_types(drawn(number), 8)]
    assert {"regular", "I", "II", "self-motion"} <= set(met)


@pytest.mark.many
@pytest.mark.parametrize("name", ["five_bar", "three_rrr", "agile_eye", "two_dof_spm"])
def test_shipped_mechanisms_by_the_kernel(name):
    """Rows, loci, inverse kinematics and the kernel say the same of one configuration."""
    made = sk.load(name)
    met = check_types(made, 16)
    assert "regular" in met and "I" in met
    kinematics = output_kinematics(made)
    solver, rest = solver_of(made), output_of(made)
    random = np.random.default_rng(4)
    poses = random.normal(size=(20, 3 if kinematics.points else 4))
    poses /= np.linalg.norm(poses, axis=1, keepdims=True)
    if not kinematics.points:
        poses = Rotation.from_quat(poses).as_matrix()
    pairs = range(len(made.pairs))
    rows = kinematics.inverse(poses, kinematics.labels, pairs)
    good = np.flatnonzero(rows.solved & np.isfinite(rows.values).all(axis=1))
    told = coefficients(make_motion(solver, rows.values[good]), rest)
    assert np.max(np.abs(told.type_two - rows.type_2[good])) < 1e-12
    # type_1 of input i is 1 / |row i of P| for q' = P w; type_one 1 / hypot(1, |P|)
    least = np.min(rows.type_1[good], axis=1)
    slope = 1.0 / np.tan(np.arcsin(told.type_one))
    count = len(made.inputs)
    assert np.all(slope < np.sqrt(count) / least * (1.0 + 1e-9))
    assert np.all(slope > 1.0 / least * (1.0 - 1e-9))
