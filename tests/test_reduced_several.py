"""Stored functions of several inputs against the equations of motion they are of."""

from dataclasses import replace

import numpy as np
import pytest
from oracles.newton_euler import with_masses_and_loads

import spherekit as sk
from spherekit.cli.main import main
from spherekit.dynamics.reduced_model_maker import reduced_grid_model
from spherekit.dynamics.reduced_model_samples import BoxSampler
from spherekit.errors import ModelError, SolveError
from spherekit.mechanism.elements import Input
from spherekit.positions.position_analysis import PositionAnalysis
from spherekit.status import Status


def with_input_ranges(mechanism, *ranges):
    """Return a mechanism whose inputs have other ranges, a (start, stop) in rad for each.

    A stored model covers the box of these ranges, so small ones are quick.
    """
    inputs = []
    for item, (start, stop) in zip(mechanism.inputs, ranges, strict=True):
        inputs.append(Input(item.pair, start, stop))
    return replace(mechanism, inputs=tuple(inputs))


@pytest.fixture(scope="module")
def loaded_five_bar():
    """Return a five-bar with masses and loads, its inputs 21 and 51 in a small box."""
    five_bar, _ = with_masses_and_loads("five_bar", np.random.default_rng(3))
    return with_input_ranges(five_bar, (1.0, 1.15), (1.2, 1.3))


@pytest.fixture(scope="module")
def stored_model(loaded_five_bar, tmp_path_factory):
    """Return the stored functions of the five-bar, written to a file and read back."""
    path = tmp_path_factory.mktemp("models") / "five_bar.npz"
    reduced_grid_model(loaded_five_bar, poles=["3/1"]).save(path)
    return sk.load_reduced(path)


def random_states(model, count=12):
    """Yield (q, dq, ddq, t): inputs in the box of the model, rates, accelerations, time.

    Units are rad, rad/s, rad/s^2 and s.
    """
    random = np.random.default_rng(7)
    for _ in range(count):
        q = random.uniform(model.heading.low, model.heading.high)
        dq = random.normal(size=2)
        ddq = random.normal(size=2)
        yield q, dq, ddq, random.uniform()


def inverse_dynamics_at(mechanism, pairs, q, dq, ddq, t):
    """Return inverse dynamics of mode 0 at time t, by laws that have this state then."""
    laws = {}
    for pair, angle, rate, acceleration in zip(pairs, q, dq, ddq, strict=True):
        # angle + rate (T - t) + acceleration (T - t)^2 / 2, by powers of the time T
        constant = angle - rate * t + 0.5 * acceleration * t * t
        laws[pair] = sk.Polynomial((constant, rate - acceleration * t, 0.5 * acceleration))
    return sk.inverse_dynamics(mechanism, laws, [t], assembly_mode=0)


def test_stored_torques_inertia_and_forces_are_those_of_inverse_dynamics(
    loaded_five_bar, stored_model
):
    """A stored model of a five-bar gives the numbers of inverse dynamics at random states.

    A stored model has the equations of motion as functions of the inputs. Driving torques,
    the inertia matrix, forces of the loads and accelerations are compared.
    """
    model = stored_model
    # The model exists in the whole box of the input ranges.
    assert model.heading.covered == 1.0
    assert model.error < 1e-10
    for q, dq, ddq, t in random_states(model):
        dynamics = inverse_dynamics_at(loaded_five_bar, model.heading.inputs, q, dq, ddq, t)
        largest = np.max(np.abs(dynamics.torques[0]))
        torque = model.torque(q.tolist(), dq.tolist(), ddq.tolist(), t)
        assert torque == pytest.approx(dynamics.torques[0], abs=1e-10 * largest)
        (torque_of_array,) = model.torque([q], [dq], [ddq], [t])
        assert torque_of_array == pytest.approx(torque, abs=1e-12 * largest)
        assert model.inertia(q) == pytest.approx(dynamics.M[0], rel=1e-10)

        (forces_by_load,) = dynamics.Q_parts  # (inputs, loads) generalised forces, N m
        stored_forces = model.forces([q], [dq], [t])
        for k, load in enumerate(dynamics.mechanism.loads):
            expected = pytest.approx(forces_by_load[:, k], abs=1e-10 * largest)
            assert stored_forces[load.name][0] == expected
        accelerations = model.accelerations(q.tolist(), dq.tolist(), torque, t)
        assert accelerations == pytest.approx(ddq, abs=1e-8)


def test_stored_angles_and_pole_rates_are_those_of_the_motion(
    loaded_five_bar, stored_model
):
    """Angle 32, and the angular velocity of link 3 against the ground per unit rate."""
    model = stored_model
    for q, dq, ddq, t in random_states(model):
        dynamics = inverse_dynamics_at(loaded_five_bar, model.heading.inputs, q, dq, ddq, t)
        angle = dynamics.values[0, loaded_five_bar.angles["32"]]
        assert model.value("theta_32", q.tolist()) == pytest.approx(angle, abs=1e-10)
        link_3 = loaded_five_bar.link_number["3"]
        rate = dynamics.motion.w[0, :, link_3]
        assert model.velocity("3/1", q) == pytest.approx(rate, abs=1e-10)
        assert model.velocity("1/3", q) == pytest.approx(-rate, abs=1e-10)


def test_a_torque_given_to_a_stored_model_is_one_more_load(stored_model):
    """The torque of a drive lowers the torque that its input still needs, by hand here."""
    q, dq, ddq, t = [1.05, 1.25], [0.4, -0.3], [0.1, 0.2], 0.7
    with_drive = stored_model.with_torque({"21": "2*sin(3*t) - dtheta_21"})
    difference = with_drive.torque(q, dq, ddq, t) - stored_model.torque(q, dq, ddq, t)
    drive_torque = 2.0 * np.sin(3.0 * t) - dq[0]
    assert difference == pytest.approx([-drive_torque, 0.0], abs=1e-12)


def test_a_given_torque_may_overflow_and_has_to_act_on_an_input(stored_model):
    q, dq, ddq, t = [1.05, 1.25], [0.4, -0.3], [0.1, 0.2], 1.0
    overflowing = stored_model.with_torque({"21": "exp(1000*t)"})
    assert overflowing.torque(q, dq, ddq, t)[0] == -np.inf
    with pytest.raises(ModelError, match='"32" is not an input'):
        stored_model.with_torque({"32": "1"})


@pytest.mark.slow
def test_a_stored_model_is_defined_where_its_assembly_mode_is_away_from_its_ends(tmp_path):
    """A stored model is defined only where its assembly mode exists.

    Functions of the two inputs of the five-bar are stored over a box of input ranges. The
    assembly mode ends inside this box, at a singularity. The domain of the model is where
    the mode exists and is not too near to this end.

    At 300 random inputs, the share of the domain must agree with the share that the file
    states (`covered`). In the domain the mode exists, and the angle is accurate to 1e-5
    rad, ten times the tolerance of the export. Outside, results are NaN for arrays of
    inputs, and an error for single inputs.
    """
    five_bar = with_input_ranges(sk.load("five_bar"), (1.2, 1.45), (1.25, 1.5))
    path, _, notes = sk.export(five_bar, tmp_path / "part.npz", tolerance=1e-6)
    model = sk.load_reduced(path)
    assert f"known in {model.heading.covered:.3g} of the box" in notes[-1]
    random = np.random.default_rng(2)
    q = random.uniform(model.heading.low, model.heading.high, (300, 2))
    motion = PositionAnalysis(five_bar, assembly_mode=0, path=q).motion()
    in_domain = model.status(q) == Status.OK
    assert np.mean(in_domain) == pytest.approx(model.heading.covered, abs=0.1)
    assert 0 < np.sum(in_domain) < np.sum(~motion.failed) < 300
    assert np.all(~motion.failed[in_domain])

    angle = model.value("theta_32", q)
    difference = angle[in_domain] - motion.values[in_domain, five_bar.angles["32"]]
    assert np.max(np.abs(np.sin(0.5 * difference))) < 1e-5
    assert np.all(np.isnan(angle[~in_domain]))
    reason = r"not in the domain of the model\. .*covers the part 0\.\d+ of the box"
    with pytest.raises(SolveError, match=reason):
        model.value("theta_32", q[~in_domain][0].tolist())
    outside_the_box = [5.0, 1.0]
    with pytest.raises(SolveError, match="not in the domain of the model"):
        model.value("theta_32", outside_the_box)


@pytest.mark.slow
def test_a_constant_inertia_is_stored_with_small_error():
    """Its derivatives are rounding only, and count relative to the inertia itself."""
    differential = with_input_ranges(sk.load("bevel_differential"), (0.2, 0.9), (0.2, 0.9))
    assert reduced_grid_model(differential).error < 1e-11


def test_the_command_exports_functions_of_several_inputs(tmp_path, capsys):
    source = tmp_path / "small.toml"
    target = tmp_path / "small.npz"
    sk.dump(with_input_ranges(sk.load("five_bar"), (1.0, 1.1), (1.2, 1.3)), source)
    assert main(["export", str(source), "--to", "model", "-o", str(target)]) == 0
    printed = capsys.readouterr().out
    assert "functions of 21, 51, errors up to" in printed
    assert "no inertia" not in printed
    assert sk.load_reduced(target).heading.inputs == ("21", "51")


def test_samples_outside_of_the_reach_are_nan():
    """If the assembly mode exists at none of the inputs, all functions are NaN there."""
    mechanism = sk.load("five_bar")
    position_analysis = PositionAnalysis(mechanism, None, 0, samples=5, grid=True)
    sampler = BoxSampler(position_analysis, ())
    function_count = len(sampler.label_functions(sampler.make_heading(0)))
    out_of_reach = np.array([[1.5, 1.5], [1.5, 2.0]])
    motion = position_analysis.at(out_of_reach)
    assert np.all(motion.status == Status.OUT_OF_REACH)
    functions = sampler.evaluate(out_of_reach, function_count)
    assert functions.shape == (2, function_count)
    assert np.all(np.isnan(functions))


def test_rates_of_a_wrong_length_are_refused(stored_model):
    """Otherwise a missing rate would be replaced by an acceleration or the time."""
    q = [1.05, 1.25]
    for dq, ddq in (([1.0], [1.0, 2.0]), ([1.0, 2.0, 3.0], [1.0])):
        with pytest.raises(SolveError, match=r"arrays of shape \(n, 2\)"):
            stored_model.torque(q, dq, ddq)
    for inputs in (1.0, [], [1.05], [1.05, 1.25, 1.0]):
        with pytest.raises(SolveError, match=r"array of shape \(n, 2\)"):
            stored_model.value("theta_32", inputs)
        with pytest.raises(SolveError, match=r"array of shape \(n, 2\)"):
            stored_model.torque(inputs, q, q)


def test_one_point_of_the_inputs_may_have_many_times_and_rates(stored_model):
    q, dq, ddq = [1.05, 1.25], [0.4, -0.3], [0.1, 0.2]
    t = np.array([0.0, 0.9])
    torques = [stored_model.torque(q, dq, ddq, time) for time in t.tolist()]
    assert stored_model.torque(q, dq, ddq, t) == pytest.approx(np.array(torques))
    rates = np.array([[0.4, -0.3], [1.0, 2.0]])
    torques = [stored_model.torque(q, rate, ddq) for rate in rates.tolist()]
    assert stored_model.torque(q, rates, ddq) == pytest.approx(np.array(torques))


def test_no_points_have_no_torques_and_no_values(stored_model):
    no_points = np.zeros((0, 2))
    assert stored_model.torque(no_points, no_points, no_points).shape == (0, 2)
    assert stored_model.value("theta_32", no_points).shape == (0,)
    assert stored_model.accelerations(no_points, no_points, no_points).shape == (0, 2)


def test_status_of_a_single_point_outside_the_box_is_out_of_reach(stored_model):
    assert stored_model.status([0.0, 0.0]).tolist() == [Status.OUT_OF_REACH]
    assert stored_model.status([1.05, 1.25]).tolist() == [Status.OK]


def test_accelerations_at_many_points_are_those_of_each_point(stored_model):
    q = np.array([[1.05, 1.25], [1.1, 1.22]])
    dq = np.array([[0.4, -0.3], [1.0, 2.0]])
    torques = np.array([[1.0, 2.0], [3.0, -4.0]])
    accelerations = stored_model.accelerations(q, dq, torques)
    assert stored_model.torque(q, dq, accelerations) == pytest.approx(torques, abs=1e-9)


def test_a_singular_inertia_matrix_is_refused():
    """Only link 2, which the input 21 drives, has a mass; the input 51 moves none."""
    five_bar, _ = with_masses_and_loads("five_bar", np.random.default_rng(3))
    masses = tuple(mass for mass in five_bar.masses if mass.link == "2")
    light = replace(five_bar, masses=masses, loads=())
    model = reduced_grid_model(with_input_ranges(light, (1.0, 1.1), (1.2, 1.25)))
    with pytest.raises(SolveError, match="inertia matrix is singular"):
        model.accelerations([1.05, 1.22], [0.0, 0.0], [1.0, 1.0])


def test_a_pole_that_is_named_twice_is_stored_once():
    poles = ("planet/frame", "frame/planet", "planet/frame")
    model = reduced_grid_model("bevel_differential", poles=poles)
    assert len(model.heading.poles) == 1
    names = [function.name for function in model.heading.functions]
    assert len(names) == len(set(names))
