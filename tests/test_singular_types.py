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
NAME_OF_CODE = ("regular", "I", "II", "III", "self-motion")
"""Names of the types by their code (`RowType`)."""


def rank(matrix):
    """Return the number of singular values above `RANK`, 0 for an empty matrix."""
    if not matrix.size:
        return 0
    return np.sum(np.linalg.svd(matrix, compute_uv=False) > RANK)


def kernel_type(mechanism, values, output):
    """Return the type of one configuration from the kernel of its velocity equations.

    Unknown are the angular velocities of all links but the first and the rates of all R
    pairs. The equations w_b - w_a = rate u of all pairs are written out, so that no loop
    and no tree is chosen. Their kernel (null space) has all motions that the links can do.

    - Type II: the output can move while the inputs rest.
    - Type I: the inputs can move while the output rests. If there are more inputs than
      freedoms of the output, this is possible everywhere. It is type I only if more
      independent motions leave the output at rest than this excess.
    - Type III: both.
    - Self-motion: links can move while inputs and output rest.

    Where curves or surfaces of configurations cross, the kernel has more motions than there
    are inputs. Type I is then not stated.

    Parameters
    ----------
    mechanism
        The mechanism, of R pairs alone.
    values
        (V,) variables of the configuration in rad.
    output
        The output: a link, the link it is seen from, and perhaps a direction of it.
    """
    closure = solver_of(mechanism).closure.linearise(values[None])
    link_count = len(mechanism.links)
    pair_count = len(mechanism.pairs)
    equations = np.zeros((3 * pair_count, 3 * link_count + pair_count))
    for k, (a, b) in enumerate(mechanism.ends):
        rows = slice(3 * k, 3 * k + 3)
        equations[rows, 3 * a : 3 * a + 3] -= np.eye(3)
        equations[rows, 3 * b : 3 * b + 3] += np.eye(3)
        equations[rows, 3 * link_count + k] = -closure.axes[0, k]
    motions = null_space(equations[:, 3:], rcond=1e-9)
    motion_count = motions.shape[1]
    rates = np.concatenate([np.zeros((3, motion_count)), motions])

    # Rates of the output (3 or 2 freedoms) and of the inputs in each motion.
    link = mechanism.link_number[output.link]
    relative_to = mechanism.link_number[output.relative_to]
    output_rates = rates[3 * link : 3 * link + 3]
    output_rates = output_rates - rates[3 * relative_to : 3 * relative_to + 3]
    freedoms = 3
    if output.direction is not None and len(mechanism.inputs) == 2:
        # Turning about its own direction does not move an output that points.
        direction = closure.rotations[0, link] @ np.array(output.direction)
        output_rates = output_rates - np.outer(direction, direction @ output_rates)
        freedoms = 2
    input_pairs = [mechanism.pair_number[item.pair] for item in mechanism.inputs]
    input_count = len(input_pairs)
    input_rates = rates[3 * link_count :][input_pairs]

    both_rest = motion_count - rank(np.concatenate([input_rates, output_rates]))
    inputs_rest = motion_count - rank(input_rates)
    output_rests = motion_count - rank(output_rates)
    # Independent motions apart from those of links that are neither input nor output; at
    # most as many as inputs. Those in excess of the freedoms of the output leave it at
    # rest in every configuration.
    effective_motion_count = min(motion_count - both_rest, input_count)
    idle_inputs = max(effective_motion_count - freedoms, 0)
    is_crossing = motion_count > input_count
    is_type_1_free = is_crossing or output_rests - both_rest == idle_inputs
    if inputs_rest != both_rest:
        return "II" if is_type_1_free else "III"
    if not is_type_1_free:
        return "I"
    return "self-motion" if both_rest or is_crossing else "regular"


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
    ("mechanism", "expected"),
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
def test_types_of_singular_rows_are_those_of_the_kernel(mechanism, expected):
    """Each row of the table has a closed configuration and the right type of singularity.

    At type I the inputs can move while the output rests, at type II the output while the
    inputs rest; type III is both. At a self-motion other links move while inputs and output
    rest. `expected` has the types that can occur, by output. The search is short, so types
    I, II and III need not be met, but self-motion must be. About 60 rows of an output are
    compared with `kernel_type`, which finds the type from the kernel (null space) of the
    velocity equations.

    The outputs 2/1 and 7/1 can only turn about one fixed axis, and the mechanism has two
    inputs. So in every configuration both inputs can move together in such a way that the
    output rests. A row with the note "in every configuration" says so.
    """
    # `slices=1`: singularities are looked for on the curves with one input locked at one
    # value, for each input. `input_grid=0`: regions without singularities are not computed.
    result = sk.run(mechanism, f"{NAME}:input_grid=0,slices=1", samples=3)
    frame = result.frame(NAME)
    for name, types in expected.items():
        rows = frame[frame.output == name]
        assert set(rows.kind) <= types
        rows_for_every_configuration = rows[rows.note == "in every configuration"]
        if name in ("2/1", "7/1"):
            assert len(rows_for_every_configuration) == 1
        else:
            assert rows_for_every_configuration.empty
        rows = rows.drop(rows_for_every_configuration.index)
        assert set(rows.kind) >= types - {"I", "II", "III"}

        output_by_name = {}
        for item in mechanism.outputs:
            output_by_name[f"{item.link}/{item.relative_to}"] = item
        output = output_by_name[name]
        values = of_rows(rows, mechanism)
        closure = solver_of(mechanism).closure.linearise(values)
        assert np.max(closure.closure_residual, initial=0.0) < 1e-12
        # About 60 rows, evenly chosen.
        step = 1 + len(rows) // 60
        for kind, configuration in zip(rows.kind[::step], values[::step], strict=True):
            assert kernel_type(mechanism, configuration, output) == kind
    # A search that takes too long is stopped, and a remark says so. None was stopped here.
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


@pytest.mark.slow
def test_one_input_has_the_same_name_for_what_moves_neither():
    """The crank as its own output: neither moves where coupler and follower are in line."""
    made = four_bar(np.radians([100.0, 50.0, 70.0, 40.0]))
    frame = sk.run(made, f"{NAME}:output=2/1", samples=9).frame(NAME)
    assert len(frame) and set(frame.kind) == {"self-motion"}
    own = Output("crank", "2", "1")
    for here in of_rows(frame, made):
        assert kernel_type(made, here, own) == "self-motion"


@pytest.mark.slow
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


def random_mechanism_with_outputs(seed):
    """Return a random mechanism with two or three inputs and three outputs.

    One seed in five gives a platform on three legs, with three inputs. One in three of
    these also has a further leg of two links, 11 and 12, between two random links. The
    others have two inputs. They are

    - random chains,
    - five-bars with a further leg between two random links,
    - or five-bars with a further leg between ground (1) and first crank (2).

    An output is a link seen from another one. Two outputs have two random links each, the
    third one has the links of the first input. If there are two inputs, the first output is
    a direction fixed in its link (`AHEAD`).
    """
    random = np.random.default_rng(seed)
    is_platform = seed % 5 == 4
    kind = seed % 3
    if is_platform:
        freedoms = 3
        edges = parse_chain("1-2 2-3 3-4 1-5 5-6 6-4 1-7 7-8 8-4")
    elif kind == 0:
        freedoms = 2
        edges = random_chain(random, links=7, freedoms=freedoms)
    else:
        freedoms = 2
        edges = list(FIVE)
    if kind == 1:
        a, b = random.choice(range(1, 6), 2, replace=False)
        edges += [(int(a), 11), (11, 12), (12, int(b))]
    if kind == 2 and not is_platform:
        edges += parse_chain("1-11 11-12 12-2")
    chain = mechanism_from_chain(edges, random_axes(random, len(edges)))
    mechanism = choose_random_inputs(random, chain, freedoms)
    assert mechanism is not None
    link_pairs = [random.choice(mechanism.links, 2, replace=False) for _ in range(2)]
    first_input = mechanism.pair_number[mechanism.inputs[0].pair]
    link_pairs.append(mechanism.pairs[first_input].links)
    if is_platform:
        directions = (None, None, None)
    else:
        directions = (AHEAD, None, None)
    outputs = []
    for (link, relative_to), direction in zip(link_pairs, directions, strict=True):
        outputs.append((link, relative_to, direction))
    return declared(mechanism, mechanism.input_pairs, outputs)


def closed(solver, count):
    """Return configurations (n, V) not far from where all variables are zero."""
    random = np.random.default_rng(1)
    starts = random.uniform(
        -0.8, 0.8, (2 * count, len(solver.closure.tree.pair_of_variable))
    )
    if solver.reference is None:
        return closed_configurations(solver, 4 * count, random)[:count]
    starts[0] = 0.0
    solution = solver.closure.solve(starts, list(solver.driven), max_steps=40)
    return solution.values[solution.closure_residual < 1e-12][:count]


def check_types(mechanism, count):
    """Compare types of regular and singular configurations with those of `kernel_type`.

    `kernel_type` finds the type from the null space of the velocity equations of all pairs.

    - Type II: the output can move while the inputs are locked.
    - Type I: the inputs can move while the output rests. Type III: both.
    - Self-motion: links can move while inputs and output rest.

    The locus of a type is the set of its configurations. At most `count` random closed
    configurations start a search for nearby points of each locus. Up to 6 of the random
    configurations are compared, and up to 8 points of each locus. Configurations whose type
    depends on rounding are left out: those close to a locus or to where two loci meet.

    Returns
    -------
    Names of the types that were compared, one for each configuration.
    """
    solver = solver_of(mechanism)
    compared_types = []
    for output in mechanism.outputs:
        # The output is a direction with up to two inputs, otherwise an orientation.
        pole = output_of(mechanism, output.name)
        if len(mechanism.inputs) <= 2:
            pole = replace(pole, pointing=output.direction)
        else:
            pole = replace(pole, pointing=None)
        reports = {
            kind: SingularityReport.for_output(solver, pole, kind)
            for kind in ("II", "I", "self-motion")
        }
        regular_values = closed(solver, count)
        configurations = [regular_values[:6]]
        for kind, report in reports.items():
            if is_singular_everywhere(report):
                assert kernel_type(mechanism, regular_values[0], output) == kind
                continue
            points = points_from(report.locus, regular_values, solver.driven).values
            configurations.append(points[:8])
            if kind == "II":
                assert np.all(report.has_type(report.types(points)))
        configurations = np.concatenate(configurations)

        rows = coefficients(make_motion(solver, configurations), pole)
        transmission = Transmission.from_mechanism(mechanism, output)
        measure = transmission.measure_configurations(solver.closure, configurations)
        assert np.max(np.abs(rows.type_two - measure)) < 1e-12

        type_2_locus = reports["II"].locus
        for k, configuration in enumerate(configurations):
            kind = kernel_type(mechanism, configuration, output)
            # `type_two` vanishes at type II, `type_one` at type I, and `hold` where some
            # link can move while the inputs are locked. At a singularity the least one is
            # below 1e-3 times `SINGULAR_TRANSMISSION`, elsewhere above 1e-3. Between them
            # rounding decides.
            least = min(rows.type_two[k], rows.type_one[k], rows.hold[k])
            if 1e-3 * SINGULAR_TRANSMISSION < least < 1e-3:
                continue
            assert reports["II"].types(configuration[None])[0] == rows.type[k]
            assert kind == NAME_OF_CODE[int(rows.type[k])]
            if kind in ("II", "III"):
                tangents = type_2_locus.tangent_space(configuration[None])
                # The equations of the locus lose rank: a motion with locked inputs exists.
                assert type_2_locus.measure(tangents).smallest_singular_value[0] < RANK
            compared_types.append(kind)
    return compared_types


LONG = pytest.param(range(12, 200), marks=pytest.mark.long)


@pytest.mark.slow
@pytest.mark.many
@pytest.mark.parametrize("seeds", [range(0, 4), range(4, 12), LONG])
def test_types_of_random_mechanisms_are_those_of_the_kernel(seeds):
    compared_types = []
    for seed in seeds:
        compared_types += check_types(random_mechanism_with_outputs(seed), 8)
    assert {"regular", "I", "II", "self-motion"} <= set(compared_types)


@pytest.mark.many
@pytest.mark.parametrize("name", ["five_bar", "three_rrr", "agile_eye", "two_dof_spm"])
def test_types_of_shipped_mechanisms_are_those_of_the_kernel(name):
    compared_types = check_types(sk.load(name), 16)
    assert "regular" in compared_types
    assert "I" in compared_types


@pytest.mark.many
@pytest.mark.parametrize("name", ["five_bar", "three_rrr", "agile_eye", "two_dof_spm"])
def test_measures_of_singularities_agree_with_inverse_kinematics(name):
    """Inverse kinematics and singularities agree in the measures of types I and II.

    A measure vanishes at its type of singularity. Up to twenty random poses are compared:
    those that the mechanism reaches.

    The measures of type II are equal. Those of type I have different definitions. Let q' =
    P w be the rates of the inputs at an angular velocity w of the output, and |P| the
    largest singular value of P:

    - `type_1` of inverse kinematics is 1 / |row i of P|, a number for each input i;
    - `type_one` of singularities is 1 / hypot(1, |P|), one number for all inputs.

    Row i of P has the rates of input i, so |row i| is 1 / `type_1`. |P| follows from
    `type_one`. It has to be at least the largest |row| and at most sqrt(inputs) times that.
    """
    mechanism = sk.load(name)
    kinematics = output_kinematics(mechanism)
    random = np.random.default_rng(4)
    # Directions if the output points, otherwise orientations as quaternions
    poses = random.normal(size=(20, 3 if kinematics.points else 4))
    poses /= np.linalg.norm(poses, axis=1, keepdims=True)
    if not kinematics.points:
        poses = Rotation.from_quat(poses).as_matrix()
    # Solutions in all working modes, with the variables of all pairs.
    all_pairs = range(len(mechanism.pairs))
    solutions = kinematics.inverse(poses, modes=kinematics.labels, pairs=all_pairs)
    is_reached = solutions.solved & np.isfinite(solutions.values).all(axis=1)
    reached = np.flatnonzero(is_reached)

    motion = make_motion(solver_of(mechanism), solutions.values[reached])
    rows = coefficients(motion, output_of(mechanism))
    assert np.max(np.abs(rows.type_two - solutions.type_2[reached])) < 1e-12
    largest_row_size = 1.0 / np.min(solutions.type_1[reached], axis=1)
    # `type_one` is the sine of an angle with the tangent 1 / |P|: in a right triangle with
    # the legs 1 and |P|, opposite the leg 1.
    size_of_P = 1.0 / np.tan(np.arcsin(rows.type_one))
    input_count = len(mechanism.inputs)
    assert np.all(size_of_P < np.sqrt(input_count) * largest_row_size * (1.0 + 1e-9))
    assert np.all(size_of_P > largest_row_size * (1.0 - 1e-9))


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("kind", ["I", "II"])
def test_a_row_without_a_configuration_has_no_determinant(kind):
    # Points of a singular curve that Newton's method does not reach are NaN.
    mechanism = load_without_loads("five_bar")
    solver = solver_of(mechanism)
    report = SingularityReport.for_output(solver, output_of(mechanism), kind)
    values = closed(solver, 4)
    values[1] = np.nan
    determinants = report.locus.measure(report.locus.tangent_space(values)).value
    assert np.isfinite(determinants).tolist() == [True, False, True, True]
