"""Quantities of rows against evaluation by names and against inverse dynamics.

A row quantity is a number of one configuration and assembly mode that sweeps, syntheses and
sensitivities can use by its name, for example `pole_4_2_y` or `torque_by_21`.
"""

import re
from dataclasses import replace
from itertools import permutations, product

import numpy as np
import pytest
from mechanism_examples.shipped_mechanisms import with_file_numbers

import spherekit as sk
from spherekit.designs.design_variables import design_variable
from spherekit.errors import EngineError
from spherekit.files.library import find
from spherekit.files.number_change import document_of
from spherekit.files.study import Study
from spherekit.mechanism.load import BearingFriction
from spherekit.plugin.designs import Sensitivity
from spherekit.symbolic.expression_evaluation import array_function
from spherekit.symbolic.expression_graph import symbols
from spherekit.symbolic.vector_algebra import singular_values
from spherekit.velocities.row_quantities import row_quantities

CASES = {
    "four_bar": ("links.2.arc", [0.7]),
    "stephenson": ("links.6.arc", [2.0]),
    "five_bar": ("links.2.arc", [0.9, 1.1]),
    "two_dof_spm": ("links.1.arcs.81", [0.4, 0.5]),
    "double_butterfly": ("pairs.C.longitude", [1.3]),
    "planetary_bevel": ("pairs.sun_planet.pressure_angle", [0.8]),
    "roller_cam": ("pairs.contact.profiles.cam.radius", [1.2]),
    "shaped_cam": ("pairs.contact.profiles.cam.cosines.1", [1.2]),
    "three_rrr": ("links.base.angle", [0.8, 0.9, 0.7]),
}
"""A number of each file that a sweep can vary, and inputs (rad) of a configuration."""
SLOW = ("two_dof_spm", "three_rrr", "double_butterfly", "roller_cam")
MARKED = [pytest.param(x, marks=[pytest.mark.slow] * (x in SLOW)) for x in CASES]
STEP, MOMENT = 2e-3, 1e-9
RATES, ACCELERATIONS = (1.3, -0.7, 0.5), (0.4, 0.9, -0.6)


@pytest.fixture(autouse=True)
def _on_arrays(monkeypatch):
    """Compiling takes longer than a row does on arrays."""
    monkeypatch.setattr("spherekit.designs.design_kernel.available", lambda: False)


def with_masses(name):
    """Return a shipped mechanism without friction that follows from reactions."""
    mechanism = sk.load(name)
    loads = (x for x in mechanism.loads if not isinstance(x, BearingFriction))
    masses = mechanism.masses or sk.load("roller_cam").masses
    return replace(mechanism, loads=tuple(loads), masses=masses)


def laws_at(mechanism, q, rates=RATES):
    """Return a law of each input that begins at q with given rate and acceleration."""
    laws = {}
    for pair, start, rate, acceleration in zip(
        mechanism.input_pairs, q, rates, ACCELERATIONS, strict=False
    ):
        laws[pair] = sk.Polynomial((start, rate, 0.5 * acceleration))
    return laws


def sweep_first_sample(name, quantities, q):
    """Return quantities (modes,) by name at the first sample of a motion, from a sweep.

    A row quantity is a number of one configuration, such as `pole_4_2_y`. A sweep only
    returns figures of merit: numbers that are reduced over the samples of a run. Here there
    are two samples, and a figure is the sum of quantity * (1 - sign(t)) over them. This
    weight is 1 at t = 0 and 0 at the later time.
    """
    mechanism = with_masses(name)
    # A sweep needs a number of the file that varies. It has its nominal value only.
    key, _ = CASES[name]
    laws = laws_at(mechanism, q)
    study = Study("", mechanism, samples=2, duration=1e-3, laws=laws)
    nominal = design_variable(document_of(mechanism), key).value
    figures = [f"F{k}=sum({x}*(1 - sign(t)))" for k, x in enumerate(quantities)]
    frame = sk.sweep(study, {key: [nominal]}, figures).frame()
    assert set(frame["status"]) == {"OK"}
    return {x: frame[f"F{k}"].to_numpy() for k, x in enumerate(quantities)}


class RowsOfFirstSample:
    """Row quantities of one configuration, in the mode order of `sk.evaluate`.

    Attributes
    ----------
    mechanism, q, inputs
        Mechanism, inputs (rad) of the configuration, and names of the input pairs.
    evaluation
        The configuration in all modes by `sk.evaluate`.
    dynamics
        Inverse dynamics of all modes at that time.
    order
        (modes,) row of the sweep for each mode of the evaluation.
    """

    def __init__(self, name, is_wanted=lambda quantity: True):
        """Evaluate the wanted quantities by a sweep, and match its modes.

        Parameters
        ----------
        name
            Key of `CASES`: a mechanism with inputs.
        is_wanted
            Function of the name of a row quantity, which says whether it is evaluated.
        """
        self.mechanism = with_masses(name)
        self.q = CASES[name][1]
        self.inputs = self.mechanism.input_pairs
        self.evaluation = sk.evaluate(self.mechanism, [self.q])
        laws = laws_at(self.mechanism, self.q)
        self.dynamics = sk.inverse_dynamics(self.mechanism, laws, [0.0])

        # The sweep and the evaluation may list modes in different orders. Sines and cosines
        # of all angles of R pairs (those with an axis) identify the modes.
        pairs = [p.name for p in self.mechanism.pairs if p.kind.has_axis]
        sines = [f"sin(theta_{pair})" for pair in pairs]
        cosines = [f"cos(theta_{pair})" for pair in pairs]
        quantities = [x for x in row_quantities(self.mechanism) if is_wanted(x)]
        names = [*sines, *cosines, *quantities]
        self.values_by_name = sweep_first_sample(name, names, self.q)

        # (numbers, modes) of the sweep and of the evaluation
        swept = np.array([self.values_by_name[x] for x in (*sines, *cosines)])
        thetas = np.array([self.evaluation.variable(pair) for pair in pairs])
        evaluated = np.concatenate([np.sin(thetas), np.cos(thetas)])
        # (modes of the sweep, modes of the evaluation). For each mode of the evaluation the
        # nearest mode of the sweep is found.
        distances = np.max(np.abs(swept[:, :, None] - evaluated[:, None]), axis=0)
        self.order = np.argmin(distances, axis=0)
        assert np.all(np.min(distances, axis=0) < 1e-9)
        assert len(set(self.order)) == swept.shape[1]

    def quantities(self, name, suffixes=("",)):
        """Return (modes, suffixes) values of the quantities `name + suffix`."""
        columns = [self.values_by_name[name + suffix][self.order] for suffix in suffixes]
        return np.array(columns).T

    def vector(self, name, suffix=""):
        """Return (modes, 3) components x, y, z of a vector quantity."""
        return self.quantities(name, [f"_{axis}{suffix}" for axis in "xyz"])

    def input_suffixes(self):
        """Return suffix and pair of each input that moves; one input has no suffix."""
        if len(self.inputs) == 1:
            return [("", self.inputs[0])]
        return [(f"_by_{pair}", pair) for pair in self.inputs]

    def component_suffixes(self):
        """Return the suffix of each component of a vector over inputs."""
        if len(self.inputs) == 1:
            return [""]
        return [f"_{pair}" for pair in self.inputs]


@pytest.fixture(scope="module")
def compared_rows():
    """Return a function of a mechanism's name that returns its `RowsOfFirstSample`.

    These are the row quantities (numbers of one configuration) that tests compare. They are
    stored for further tests. Quantities of links, such as orientations and poles, are
    evaluated for about five links only, to save time.
    """
    rows_by_name = {}

    def evaluate_rows(name):
        if name not in rows_by_name:
            # Names of quantities are such as angular_velocity_3_x, pole_4_2_y or
            # velocity_coefficient_4_1_by_21. Those with another link are left out. "-" is
            # in no name, so that nothing is left out if there are no other links.
            links = links_to_compare(name)
            other_links = "|".join({*sk.load(name).links} - {*links}) or "-"
            left_out = re.compile(
                rf"(orient|angular|pole|veloc|accel).*_({other_links})(_|$)"
            )
            rows_by_name[name] = RowsOfFirstSample(
                name, lambda quantity: not left_out.match(quantity.split("_by_")[0])
            )
        return rows_by_name[name]

    return evaluate_rows


def links_to_compare(name):
    """Return about five links, evenly chosen."""
    links = sk.load(name).links
    return links[:: 1 + len(links) // 5]


@pytest.mark.many
@pytest.mark.parametrize("name", MARKED)
def test_orientations_and_rates_by_quantities_are_those_of_evaluation(name, compared_rows):
    """Row quantities of links are the numbers of `sk.evaluate`.

    A sweep computes row quantities: numbers of one configuration, chosen by their names.
    `compared_rows` returns them. Compared are the entries of rotation matrices, and the
    components of angular velocities per unit rate of an input and of their derivatives.
    With several inputs, a suffix of the name says which one moves. Errors are divided by 1
    plus the largest rate, or by its square for derivatives. Rows without numbers are NaN.
    """
    rows = compared_rows(name)
    links = links_to_compare(name)
    entries = [f"_{i}{j}" for i, j in product("xyz", repeat=2)]
    for link in links:
        rotation = rows.quantities(f"orientation_{link}", entries).reshape(-1, 3, 3)
        assert np.max(np.abs(rotation - rows.evaluation.rotation(link))) < 1e-12
    for suffix, moving in rows.input_suffixes():
        w = {link: rows.evaluation.angular_velocity(link, moving) for link in links}
        scale = 1.0 + np.max(np.abs([*w.values()]), axis=(0, 2))[:, None]
        for link in links:
            rate = rows.vector(f"angular_velocity_{link}", suffix)
            assert np.nanmax(np.abs(rate - w[link]) / scale) < 1e-11
            derivative = rows.evaluation.angular_velocity_dq(link, moving)
            rate_dq = rows.vector(f"angular_velocity_dq_{link}", suffix)
            assert np.nanmax(np.abs(rate_dq - derivative) / scale**2) < 1e-10


@pytest.mark.many
@pytest.mark.parametrize("name", MARKED)
def test_pole_axes_by_quantities_are_those_of_relative_rates(name, compared_rows):
    """Pole axes by names such as `pole_4_2_y` are those of relative rates of links.

    A sweep of designs computes numbers of a configuration that are chosen by such names.
    `compared_rows` returns an object with these numbers for one configuration in all modes.
    `pole_4_2` is the axis about which link 4 turns relative to link 2. Pole times velocity
    coefficient must be the difference of the angular velocities by `sk.evaluate`. If a pair
    joins two links, the pole of its second link relative to the first must be its axis.
    """
    rows = compared_rows(name)
    links = links_to_compare(name)
    # With several inputs, each of them moves alone while the others are locked. Names then
    # end in a suffix with the input that moves.
    for suffix, moving_input in rows.input_suffixes():
        w = {link: rows.evaluation.angular_velocity(link, moving_input) for link in links}
        scale = 1.0 + np.max(np.abs([*w.values()]), axis=(0, 2))[:, None]
        for a, b in permutations(links, 2):
            pole = rows.vector(f"pole_{a}_{b}", suffix)
            coefficient = rows.quantities(f"velocity_coefficient_{a}_{b}", [suffix])
            misses = np.abs(pole * coefficient - (w[a] - w[b])) / scale
            assert np.nanmax(misses, initial=0.0) < 1e-11
            turns = np.abs(coefficient[:, 0]) > 1e-9
            assert np.allclose(np.linalg.norm(pole[turns], axis=1), 1.0, rtol=1e-13)
    for pair in rows.mechanism.pairs:
        if pair.kind.has_axis and {*pair.links} <= {*links}:
            # The axis of a pair does not depend on the input that moves, so the suffix of
            # the last input is as good as any other.
            first, second = pair.links
            axis = rows.vector(f"axis_{pair.name}")
            assert np.array_equal(axis, rows.vector(f"pole_{second}_{first}", suffix))


@pytest.mark.many
@pytest.mark.parametrize("name", MARKED)
def test_directions_of_outputs_by_quantities_are_those_of_rotations(name, compared_rows):
    """Directions are stated in the frame of the link that the output is relative to."""
    rows = compared_rows(name)
    for output in rows.mechanism.outputs:
        if output.direction is None:
            continue
        base_rotation = rows.evaluation.rotation(output.relative_to)
        relative_rotation = np.swapaxes(base_rotation, 1, 2)
        relative_rotation = relative_rotation @ rows.evaluation.rotation(output.link)
        direction = rows.vector(f"direction_{output.name}")
        assert np.max(np.abs(direction - relative_rotation @ output.direction)) < 1e-12


@pytest.mark.many
@pytest.mark.parametrize("name", MARKED)
def test_forces_and_free_accelerations_are_those_of_inverse_dynamics(name):
    """Forces, torques, inertia and energy by name are those of inverse dynamics.

    `RowsOfFirstSample` computes the quantities by their names at the first sample of a
    sweep, and the inverse dynamics at the same inputs. "B" is the name of the mass matrix,
    here called M. The free acceleration is that of the inputs if no torque drives them. The
    inputs follow a law of time with another acceleration. From M ddq + h = torque follows M
    (free acceleration - acceleration of the law) = -torque.

    With several inputs, names of quantities end with an input. The component of the free
    acceleration that belongs to the input 21 ends in _21 (`component_suffixes`). A torque
    or force at this input ends in _by_21 (`input_suffixes`). An entry of the mass matrix
    ends in both.
    """
    beginnings = ("torque", "generalized", "free", "kinetic", "B")
    rows = RowsOfFirstSample(name, lambda quantity: quantity.startswith(beginnings))
    dynamics = rows.dynamics
    input_suffixes = [suffix for suffix, _ in rows.input_suffixes()]
    is_good = dynamics.status == sk.Status.OK
    assert np.any(is_good)
    free = rows.quantities("free_acceleration", rows.component_suffixes())
    excess = free - dynamics.input_accelerations
    torques_of_excess = (dynamics.M @ excess[:, :, None])[:, :, 0]
    # The mass matrix row by row: (modes, inputs * inputs).
    matrix_suffixes = []
    for component in rows.component_suffixes():
        for suffix in input_suffixes:
            matrix_suffixes.append(component + suffix)
    mass_matrix = dynamics.M.reshape(len(dynamics.M), -1)
    for computed, expected in (
        (rows.quantities("generalized_force", input_suffixes), dynamics.Q_all),
        (rows.quantities("torque", input_suffixes), dynamics.torques),
        (rows.quantities("kinetic_energy"), dynamics.kinetic[:, None]),
        (rows.quantities("B", matrix_suffixes), mass_matrix),
        (torques_of_excess, -dynamics.torques),
    ):
        scale = np.max(np.abs(expected[is_good]), axis=1, keepdims=True) + 1e-9
        assert np.max(np.abs(computed - expected)[is_good] / scale) < 1e-9


def test_the_determinant_of_a_four_bar_is_the_triple_product_of_its_passive_axes():
    """Its sign differs between both modes."""
    rows = RowsOfFirstSample("four_bar")
    passive_axes = [rows.vector(f"axis_{pair}") for pair in ("32", "43", "41")]
    triple_product = np.linalg.det(np.stack(passive_axes, axis=1))
    determinant = rows.quantities("determinant")[:, 0]
    assert np.allclose(np.abs(determinant), np.abs(triple_product), rtol=1e-13)
    assert np.all(np.sign(determinant[0]) == -np.sign(determinant[1]))


class StencilLaw:
    """A law with a given state of the input at each of several times `MOMENT` apart."""

    def __init__(self, states):
        """Store the states, an array (3, times) of angle, rate and acceleration."""
        self.states = states

    def at(self, t):
        """Return angle, rate and acceleration at times that are multiples of `MOMENT`."""
        return tuple(self.states[:, np.rint(np.asarray(t) / MOMENT).astype(int)])


@pytest.mark.many
@pytest.mark.parametrize("name", MARKED)
def test_linearised_accelerations_agree_with_differences_of_inverse_dynamics(name):
    """A_q, A_dq and B_torque are derivatives of accelerations at constant torques.

    Control needs them. From M ddq + h(q, dq) = torque, A_q and A_dq are -M^-1 times the
    derivatives of the torque by q and dq at constant accelerations, and B_torque is M^-1.
    The reference are five-point differences of the torques that inverse dynamics finds. One
    angle or one rate is changed at a time, by -2, -1, 1 and 2 times `STEP` (rad or rad/s).

    One call of inverse dynamics evaluates all these states. Its argument are laws of time,
    so each state gets a time of its own: state k has the time k times `MOMENT`. A
    `StencilLaw` returns the state that belongs to a time. The times are so short that loads
    hardly depend on them.
    """
    # The quantities by their names, at the first sample of a run.
    rows = RowsOfFirstSample(name, lambda x: x.startswith(("A_", "B_torque")))
    count = len(rows.inputs)
    state = np.array([rows.q, RATES[:count], ACCELERATIONS[:count]])
    # A change has its kind (0: angle, 1: rate), the number of the input, and its steps.
    changes = list(product((0, 1), range(count), (-2, -1, 1, 2)))
    states = np.tile(state, (len(changes), 1, 1))
    for row, (kind, j, steps) in enumerate(changes):
        states[row, kind, j] += steps * STEP
    laws = {}
    for k, pair in enumerate(rows.inputs):
        laws[pair] = StencilLaw(states[:, :, k].T)
    times = MOMENT * np.arange(len(states))
    torques = sk.inverse_dynamics(rows.mechanism, laws, times).torques
    # The rows of `torques` are the states of mode 0, then those of mode 1, and so on. Here
    # they get the axes (modes, kinds, changed inputs, steps, torques).
    torques = torques.reshape(-1, 2, count, 4, count)
    two_back, one_back, one_ahead, two_ahead = np.moveaxis(torques, 3, 0)
    differences = two_back - 8.0 * one_back + 8.0 * one_ahead - two_ahead
    # (modes, kinds, torques, changed inputs)
    slopes = np.swapaxes(differences / (12.0 * STEP), 2, 3)
    inverse_mass = np.linalg.inv(rows.dynamics.M)
    # The same matrix is used for both kinds.
    expected = -(inverse_mass[:, None] @ slopes)
    is_good = np.all(np.isfinite(expected), axis=(1, 2, 3))
    assert np.any(is_good)

    # With two inputs 11 and 21, A_q_11_by_21 is the derivative of the acceleration of 11 by
    # the angle of 21. `changed` is an ending such as _by_21, and j the number of this
    # input; `component` is a middle part such as _11.
    for j, (changed, _) in enumerate(rows.input_suffixes()):
        suffixes = [f"{component}{changed}" for component in rows.component_suffixes()]
        for kind, quantity in enumerate(("A_q", "A_dq")):
            derivative = expected[is_good, kind, :, j]
            # Errors are relative, or for small derivatives absolute.
            scale = np.max(np.abs(derivative), axis=1, keepdims=True) + 1e-3
            computed = rows.quantities(quantity, suffixes)[is_good]
            assert np.max(np.abs(computed - derivative) / scale) < 3e-7
        # B_torque needs no differences. It is NaN in modes that failed.
        by_torque = rows.quantities("B_torque", suffixes)
        assert np.nanmax(np.abs(by_torque / inverse_mass[:, :, j] - 1.0)) < 1e-12


@pytest.mark.slow
@pytest.mark.parametrize("name", ["five_bar", "three_rrr"])
def test_condition_numbers_are_those_of_the_jacobian_of_inverse_kinematics(name):
    """Condition number and determinant are those of the Jacobian of inverse kinematics.

    `RowsOfFirstSample` has these numbers of a sweep at its first sample. The Jacobian (3,
    inputs) has the angular velocity of the output per unit rate of each input. The
    condition number is the ratio of its largest and smallest singular values. An output
    that is a direction has two inputs only. The determinant is then that of the two columns
    of the Jacobian and the direction as the third.
    """
    # Only quantities whose names begin so are evaluated.
    rows = RowsOfFirstSample(name, lambda x: x.startswith(("condition", "jacobian")))
    (output,) = rows.mechanism.outputs
    has_direction = output.direction is not None
    pose = rows.evaluation.rotation(output.link)
    if has_direction:
        pose = pose @ output.direction
    # With `normals=True` the result has what is needed for its attribute `jacobian`.
    inverse = sk.InverseKinematics(rows.mechanism).at(pose, normals=True)
    # A pose has several working modes (ways to bend the legs). The right one has the inputs
    # of the configuration. The axes of `inverse.inputs` are working modes, poses, inputs.
    differences = np.angle(np.exp(1j * (inverse.inputs - rows.q)))
    working_mode = np.argmin(np.max(np.abs(differences), axis=2), axis=0)
    jacobian = inverse.jacobian[working_mode, np.arange(len(pose))]
    singular = np.linalg.svd(jacobian, compute_uv=False)
    condition = rows.quantities(f"condition_number_{output.name}")[:, 0]
    assert condition == pytest.approx(singular[:, 0] / singular[:, -1], rel=1e-9)
    if has_direction:
        jacobian = np.concatenate([jacobian, pose[:, :, None]], axis=2)
    determinant = rows.quantities(f"jacobian_determinant_{output.name}")[:, 0]
    assert determinant == pytest.approx(np.linalg.det(jacobian), rel=1e-9)


@pytest.mark.parametrize("columns", [2, 3])
def test_singular_values_by_expressions_are_those_of_lapack(columns):
    """Singular values by symbolic expressions agree with LAPACK.

    The condition number of an output's Jacobian is computed from these expressions. There
    are 20000 random 3 x 2 or 3 x 3 matrices. Columns of every second matrix have sizes down
    to 1e-4; the first three matrices are orthogonal, of rank 1, and zero. The tolerance is
    about 13 roundings of the largest value.
    """
    count = 20000
    random = np.random.default_rng(4)
    matrices = random.normal(size=(count, 3, columns))
    matrices[::2] *= 10.0 ** random.uniform(-4.0, 0.0, size=(count // 2, 1, columns))
    matrices[0] = np.eye(3)[:, :columns]
    matrices[1] = 1.0
    matrices[2] = 0.0
    entries = symbols(f"x{k}" for k in range(3 * columns))
    expressions = singular_values([*np.reshape(entries, (3, columns)).T])
    function = array_function(expressions, entries)
    values = function(matrices.reshape(count, -1).T).T
    expected = np.linalg.svd(matrices, compute_uv=False)
    largest = expected[:, :1] + 1e-300  # not zero
    assert np.max(np.abs(values - expected) / largest) < 3e-15


@pytest.mark.slow
@pytest.mark.parametrize(
    "name, key, quantities",
    [
        ("four_bar", "links.3.arc", ["A_q", "A_dq", "pole_4_2_y", "determinant"]),
        ("five_bar", "links.2.arc", ["A_q_21_by_51", "condition_number_pointer"]),
    ],
)
def test_derivatives_by_a_size_are_differences_of_designs(name, key, quantities):
    """Derivatives of quantities by a size agree with differences between designs.

    `Sensitivity` computes the derivatives. For comparison, the quantities are computed for
    designs with four other sizes, at distances of 1e-4 and 2e-4 rad on both sides. They
    give a finite difference of fourth order. `key` names the size in the mechanism file, an
    arc of a link; `quantities` are names of columns. All rows have the same rates and
    accelerations of the inputs, and the time 0. Errors are divided by the size of the
    derivative plus 0.01, so that a derivative may be zero.
    """
    nominal = with_masses(name)
    count = len(nominal.inputs)
    nominal_size = design_variable(document_of(nominal), key).value  # deg

    def values_and_derivatives(mechanism):
        """Return the quantities of a design and their derivatives by the size.

        The samples of the inputs are the same for all designs.
        """
        samples = 4 if count == 1 else (2,) * count
        motion = sk.trace(mechanism, samples=samples, search=False)
        sensitivity = Sensitivity(mechanism, [key], quantities)
        # Columns: inputs, their rates, their accelerations, and the time 0.
        rows = np.zeros((len(motion.inputs), 3 * count + 1))
        rows[:, :count] = motion.inputs
        rows[:, count:-1] = [*RATES[:count], *ACCELERATIONS[:count]]
        return sensitivity.at(rows, motion.values)

    step = 1e-4  # rad
    values = []
    for position in (-2, -1, 1, 2):
        size = nominal_size + np.degrees(step * position)
        design = with_file_numbers(nominal, {key: size})
        values.append(values_and_derivatives(design)[0])
    expected = np.tensordot([1.0, -8.0, 8.0, -1.0], values, 1) / (12.0 * step)
    (derivatives,) = values_and_derivatives(nominal)[1]
    is_comparable = np.isfinite(derivatives) & np.isfinite(expected)
    assert np.all(np.any(is_comparable, axis=1))
    errors = np.abs(derivatives - expected) / (np.abs(expected) + 1e-2)
    assert np.nanmax(errors) < 1e-8


DIRECTION_FIGURES = [f"{x}=at(direction_pointer_{x}, 50, 60)" for x in "xyz"]
"""Components of the five-bar's output at the inputs 50 and 60 deg, for a sweep."""
FIGURE_INPUTS = np.radians([[50.0, 60.0]])


def test_an_output_along_an_axis_follows_it_in_other_designs():
    """In designs with another arc of link 3 the direction is that of the displaced axis."""
    key = "links.3.arc"
    sweep = sk.sweep("five_bar", {key: [60.0, 80.0]}, DIRECTION_FIGURES, samples=3)
    for arc, rows in sweep.frame().groupby("links_3_arc"):
        design = with_file_numbers("five_bar", {key: arc})
        rotation = sk.evaluate(design, FIGURE_INPUTS).rotation("3")
        expected = rotation @ design.outputs[0].direction
        assert np.allclose(rows[["x", "y", "z"]], expected, rtol=0.0, atol=1e-12)


LONGITUDE = "outputs.pointer.longitude"


@pytest.fixture
def file_with_direction(tmp_path):
    """Return a file of the five-bar whose output points along a vector in link 3."""
    text = find("five_bar").read_text().replace('axis = "43"', "xyz = [0.36, 0.48, 0.8]")
    path = tmp_path / "bar.toml"
    path.write_text(text)
    return path


def test_a_sweep_varies_the_direction_of_an_output(file_with_direction):
    """Two longitudes in the link's frame, in two modes; the link's rotation is the same."""
    longitudes = {LONGITUDE: [20.0, 70.0]}
    frame = sk.sweep(file_with_direction, longitudes, DIRECTION_FIGURES, samples=3).frame()
    assert len(frame) == 4
    rotation = sk.evaluate(file_with_direction, FIGURE_INPUTS).rotation("3")
    for longitude, rows in frame.groupby("outputs_pointer_longitude"):
        design = with_file_numbers(file_with_direction, {LONGITUDE: longitude})
        direction = design.outputs[0].direction
        x, y, _ = direction
        assert np.arctan2(y, x) == pytest.approx(np.radians(longitude))
        components = rows[["x", "y", "z"]]
        assert np.allclose(components, rotation @ direction, rtol=0.0, atol=1e-12)


def test_the_derivative_of_a_direction_by_its_longitude_is_a_horizontal_vector(
    file_with_direction,
):
    """The direction (x, y, z) in the link changes by (-y, x, 0) per rad of longitude."""
    mechanism = sk.load(file_with_direction)
    sensitivity = Sensitivity(mechanism, [LONGITUDE], ["direction_pointer_y"])
    motion = sk.trace(file_with_direction, samples=(2, 2))
    states_at_rest = sensitivity.at_rest(motion.inputs)
    _, derivatives = sensitivity.at(states_at_rest, motion.values)
    inputs_of_one_mode = motion.inputs[: len(motion) // 2]
    rotation = sk.evaluate(file_with_direction, inputs_of_one_mode).rotation("3")
    x, y, _ = mechanism.outputs[0].direction
    expected_y = rotation[:, 1] @ [-y, x, 0.0]
    assert np.allclose(derivatives[0, 0], expected_y, rtol=0.0, atol=1e-12, equal_nan=True)


def write_four_bar(path, links):
    """Write the file of a four-bar whose links have given names; pair a is its input."""
    pairs = ("a", "b", "c", "d")
    lines = ["format = 1", 'name = "bar"', 'angle_unit = "deg"', f'ground = "{links[0]}"']
    for k, (link, arc) in enumerate(zip(links, (60, 20, 70, 40), strict=True)):
        axes = f'axes = ["{pairs[k - 1]}", "{pairs[k]}"]'
        lines += [f"[links.{link}]", axes, f"arcs = [{arc}.0]"]
    for k, pair in enumerate(pairs):
        ends = f'links = ["{links[k]}", "{links[(k + 1) % 4]}"]'
        lines += [f"[pairs.{pair}]", 'type = "R"', ends]
    lines += [f"[inputs.{pairs[0]}]", "from = 0.0", "to = 360.0"]
    path.write_text("\n".join(lines))
    return path


@pytest.mark.parametrize(
    "links, quantity, meanings",
    [
        (("1", "1_2", "2_3", "3"), "pole_1_2_3_x", ("pole (1, 2_3)", "pole (1_2, 3)")),
        # Four meanings: (x, x_x_x_x), (x_x, x_x_x), and both in the opposite order.
        (
            ("x", "x_x", "x_x_x", "x_x_x_x"),
            "pole_x_x_x_x_x_x",
            ("pole (x, x_x_x_x)", "pole (x_x, x_x_x)"),
        ),
        (
            ("1", "2", "dq_2", "4"),
            "angular_velocity_dq_2_x",
            ("angular velocity (_dq, 2)", "angular velocity (dq_2)"),
        ),
    ],
)
def test_an_ambiguous_name_is_refused_with_two_of_its_meanings(
    tmp_path, links, quantity, meanings
):
    """Names of links contain underscores, so that a name has two to four meanings."""
    path = write_four_bar(tmp_path / "bar.toml", links)
    first, second = meanings
    message = f'"{quantity}" can mean {first} or {second}; give'
    with pytest.raises(EngineError, match=re.escape(message)):
        sk.sweep(path, {f"links.{links[1]}.arc": [20.0]}, [f"F=max({quantity})"])


def test_the_angle_of_an_input_is_the_input_beyond_a_turn_too():
    """A sweep gives the angle that the table motion has: 9 rad stay 9 rad."""
    mechanism = sk.load("four_bar")
    (crank,) = mechanism.inputs
    mechanism = replace(mechanism, inputs=(replace(crank, start=-4.0, stop=9.0),))
    figures = ["least=min(theta_21)", "largest=max(theta_21)"]
    study = Study("", mechanism, samples=9)
    frame = sk.sweep(study, {"links.2.arc": [20.0]}, figures).frame()
    np.testing.assert_allclose(frame["least"], np.rad2deg(-4.0), rtol=1e-12)
    np.testing.assert_allclose(frame["largest"], np.rad2deg(9.0), rtol=1e-12)
