"""Stored functions of a mechanism against other routes to the same values."""

import json
import pickle
import re
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest
from helpers.refusals import TABLES, check_call
from mechanism_examples.shipped_mechanisms import load_without_loads

from spherekit.cli.main import main
from spherekit.dynamics.inverse_dynamics import inverse_dynamics
from spherekit.dynamics.reduced_model import MODEL_FORMAT, load_reduced
from spherekit.dynamics.reduced_model_maker import reduced_model
from spherekit.errors import FileError, ModelError, SolveError
from spherekit.files.mechanism_reader import load
from spherekit.files.mechanism_writer import dumps
from spherekit.files.time_law import Polynomial
from spherekit.mechanism.load_kinds import JointLimit
from spherekit.planning.pole_plan import parse_pole
from spherekit.positions.position_analysis import PositionAnalysis
from spherekit.status import Status
from spherekit.storage.numpy_archive import write_archive
from spherekit.velocities.pole_evaluation import evaluate
from spherekit.velocities.pole_request import request

TURN = 2.0 * np.pi


@pytest.fixture(scope="module")
def four_bar():
    return load("four_bar")


@pytest.fixture(scope="module")
def models(four_bar, tmp_path_factory):
    """Return the stored models of both modes of the four-bar, saved and loaded."""
    path = tmp_path_factory.mktemp("models") / "mode.npz"
    loaded_models = []
    for assembly_mode in (0, 1):
        reduced_model(four_bar, assembly_mode=assembly_mode).save(path)
        loaded_models.append(load_reduced(path))
    return loaded_models


def largest_error(mechanism, model, assembly_mode, count, names):
    """Return the largest error of a stored model at random inputs within one turn.

    A stored model has pole directions, velocity and acceleration coefficients and pair
    variables as series in the input, for one assembly mode (way to assemble the links). A
    pole is the axis of the relative rotation of two links. The reference is the ordinary
    evaluation. Errors of coefficients are divided by their largest size. Errors of angles
    are the sines of half the differences, so that whole turns do not count.

    Parameters
    ----------
    mechanism, model, assembly_mode
        The mechanism, and the stored model of one of its assembly modes.
    count
        Number of inputs.
    names
        Poles that are compared, such as "3/1".
    """
    position_analysis = PositionAnalysis(mechanism, assembly_mode=assembly_mode)
    inputs = np.sort(np.random.default_rng(5).uniform(0.0, TURN, count))
    motion = position_analysis.at(inputs)
    poles = [parse_pole(mechanism, name) for name in names]
    # The directions of these poles, and their rates.
    pole_request = request(mechanism, position_analysis.inputs[0], poles, rates=poles)
    field = evaluate(motion, pole_request)
    errors = []
    for name, pole in zip(names, poles, strict=True):
        stored_direction = model.pole(name, inputs)
        # The sense of a pole axis is arbitrary.
        sense = np.sign(np.sum(field.direction[pole] * stored_direction, axis=1))
        difference = field.direction[pole] * sense[:, None] - stored_direction
        errors.append(np.max(np.abs(difference)))
        for expected, stored in (
            (field.velocity_coefficient[pole], model.rate(name, inputs)),
            (field.acceleration_coefficient[pole], model.rate_derivative(name, inputs)),
        ):
            largest = np.max(np.abs(expected))
            scale = largest if largest > 1e-9 else 1.0
            errors.append(np.max(np.abs(expected * sense - stored)) / scale)
    for number, variable in enumerate(mechanism.variable_names):
        difference = motion.values[:, number] - model.value(variable, inputs)
        errors.append(np.max(np.abs(np.sin(0.5 * difference))))
    return max(errors)


@pytest.mark.parametrize("assembly_mode", [0, 1])
def test_every_pole_and_coefficient_is_that_of_the_plan(four_bar, models, assembly_mode):
    model = models[assembly_mode]
    assert model.heading.by == ("q",)
    assert model.error < 1e-12
    names = model.heading.poles
    assert len(names) == 6
    assert largest_error(four_bar, model, assembly_mode, 2000, names) < 1e-12


def test_a_pole_that_turns_fast_has_narrow_cells_and_the_same_error():
    mechanism = load_without_loads("stephenson")
    names = ("6/3", "5/2", "3/1")
    model = reduced_model(mechanism, poles=names)
    assert len(model.groups[1].edges) > len(model.groups[2].edges)
    assert largest_error(mechanism, model, 0, 2000, names) < 1e-12


@pytest.mark.parametrize("assembly_mode", [0, 1])
def test_stored_inertia_and_torque_are_those_of_inverse_dynamics(
    four_bar, models, assembly_mode
):
    """A stored model gives the same inertia, forces and torque as `inverse_dynamics`.

    `models` are the stored models of both assembly modes of the four-bar. B is the inertia
    reduced to the input, Q the generalised force of all loads, and tau the driving torque.
    They are compared along a polynomial law of time, and at single times after pickling.
    """
    model = models[assembly_mode]
    t = np.linspace(0.0, 2.0, 400)
    law = Polynomial((0.3, 1.0, 2.0, -0.5))
    dynamics = inverse_dynamics(four_bar, law, t, assembly_mode=assembly_mode)
    state = (dynamics.q, dynamics.dq, dynamics.ddq, t)
    force = sum(model.forces(dynamics.q, dynamics.dq, t).values())
    for expected, stored in (
        (dynamics.B, model.inertia(dynamics.q)),
        (dynamics.dB_dq, model.inertia_rate(dynamics.q)),
        (dynamics.Q, force),
        (dynamics.tau, model.torque(*state)),
    ):
        assert np.max(np.abs(expected - stored)) < 1e-12 * np.max(np.abs(expected))
    for row in range(0, 400, 57):
        # From the second pass on, the model has compiled functions, which are not pickled.
        model = pickle.loads(pickle.dumps(model))
        torque = model.torque(*(float(values[row]) for values in state))
        assert isinstance(torque, float)
        assert abs(torque - dynamics.tau[row]) < 1e-12 * np.max(np.abs(dynamics.tau))


def test_whole_turns_of_the_input_do_not_change_poles(models):
    """Angles grow by the turns; poles are periodic."""
    model = models[0]
    for x in (-40.0, -0.1, 0.0, 6.9, 300.0):
        assert np.allclose(model.pole("3/1", x), model.pole("1/3", x % TURN), atol=1e-12)
        assert abs(model.value("theta_21", x) - x) < 1e-12 * max(1.0, abs(x))
        assert np.allclose(model.value("theta_21", np.array([x])), x, rtol=1e-14)


def test_without_a_crank_the_coordinate_is_the_arc_length(four_bar):
    """Without a link that turns fully, the coordinate of a model is an arc length.

    With these arcs (deg) the input goes forth and back, so it does not determine the
    configuration. The coordinate is the arc length s in the space of all pair angles. So
    the derivatives of the angles by s must form a unit vector. The velocity coefficient of
    the pole 2/1 (axis of the input) must be the derivative of the input angle by s.
    """
    links = four_bar.geometry.links
    sizes = {}
    for link, arc in {"1": 60.0, "2": 55.0, "3": 70.0, "4": 40.0}.items():
        sizes[link] = replace(links[link], arcs=(np.deg2rad(arc),))
    mechanism = replace(four_bar, geometry=replace(four_bar.geometry, links=sizes))
    model = reduced_model(mechanism)
    # The heading of the model names its coordinate, and says that the curve is closed.
    assert model.heading.by == ("s",)
    assert model.heading.periodic
    assert model.error < 1e-12
    s = np.linspace(0.0, 40.0, 300)
    tangents = [model.value(f"d({name})/ds", s) for name in mechanism.variable_names]
    assert np.max(np.abs(np.sum(np.square(tangents), axis=0) - 1.0)) < 1e-12
    input_rate = tangents[0]  # the first variable is the input angle
    assert np.allclose(np.abs(model.rate("2/1", s)), np.abs(input_rate), atol=1e-12)


def test_an_open_curve_refuses_arc_lengths_beyond_its_ends(four_bar):
    """The limits of pair 21, 0.5 and 4.5 rad, are the ends."""
    limited = replace(four_bar, joint_limits=(JointLimit("21", 0.5, 4.5),))
    model = reduced_model(limited, poles=("3/1",))
    (high,) = model.heading.high
    assert not model.heading.periodic
    assert np.allclose(np.sort(model.value("theta_21", [0.0, high])), [0.5, 4.5])
    for x in (high + 0.1, -0.1, float("nan"), np.array([0.1, high + 0.1])):
        with pytest.raises(SolveError, match="must be within 0 to"):
            model.pole("3/1", x)


@pytest.mark.slow
def test_joint_limits_more_than_a_turn_apart_end_a_stored_model(four_bar):
    """The crank of a four-bar can turn fully, but its limits are 500 deg apart."""
    limits = np.radians([-400.0, 100.0])
    limited = replace(four_bar, joint_limits=(JointLimit("21", *limits.tolist()),))
    model = reduced_model(limited, poles=("3/1",))
    assert not model.heading.periodic
    ends = model.value("theta_21", [0.0, model.heading.high[0]])
    assert np.allclose(np.sort(ends), limits, rtol=0, atol=1e-10)


@pytest.mark.parametrize("call", TABLES["stored models"])
def test_bad_requests_name_the_nearest_match(models, call):
    names = {
        "model": models[0],
        "reduced_model": reduced_model,
        "load_without_loads": load_without_loads,
    }
    check_call(call, names, TABLES["stored models"][call])


def test_damaged_files_of_stored_models_are_refused(models, tmp_path):
    """Damaged files of stored models are refused, with a message that names the damage.

    A stored model has quantities of a mechanism as functions of its position, such as its
    inertia reduced to the input. The range of the position is divided into cells. In each
    cell a function is a Chebyshev series.

    The file of a model is an archive of NumPy with a header in JSON and a checksum. The
    functions are stored in groups. The array "coefficients_k" has the coefficients of all
    functions of group k. Its axes are the cell, the order in the series, and the function.
    Files changed by `write_changed` get a valid checksum. So they are refused for their
    content, not for their checksum.
    """
    valid_file = tmp_path / "good.npz"
    models[0].save(valid_file)
    with np.load(valid_file) as archive:
        arrays = dict(archive)
    header = json.loads(str(arrays.pop("header")))

    def write_changed(name, version=MODEL_FORMAT.version, **changed_arrays):
        file_format = replace(MODEL_FORMAT, version=version)
        fields = {k: x for k, x in header.items() if k not in ("format", "version")}
        write_archive(tmp_path / name, file_format, fields, {**arrays, **changed_arrays})
        return tmp_path / name

    # The inertia "B" is function 8 of group 0. One of its coefficients becomes NaN.
    with_nan = arrays["coefficients_0"].copy()
    some_cell, some_order, function_of_inertia = 3, 2, 8
    with_nan[some_cell, some_order, function_of_inertia] = np.nan
    # Group 1 has five functions, so its array has five columns (its last axis).
    too_few_columns = arrays["coefficients_1"][..., :3]
    np.savez(tmp_path / "foreign.npz", a=np.zeros(3))
    np.savez(tmp_path / "no_checksum.npz", header=np.array(json.dumps(header)), **arrays)
    for path, message in (
        (
            write_changed("version.npz", version=1),
            "has version 1 of the format, but spherekit",
        ),
        (
            write_changed("nan.npz", coefficients_0=with_nan),
            '"B" has coefficients that are not fin',
        ),
        (
            write_changed("columns.npz", coefficients_1=too_few_columns),
            "columns for 5 functions",
        ),
        (tmp_path / "foreign.npz", "is not a spherekit reduced model"),
        (tmp_path / "no_checksum.npz", "checksum is missing.*create it again"),
        (tmp_path / "absent.npz", "cannot be read: No such file"),
    ):
        with pytest.raises(FileError, match=message):
            load_reduced(path)

    content = valid_file.read_bytes()
    for length in (0, 100, len(content) // 2, len(content) - 30):
        (tmp_path / "cut.npz").write_bytes(content[:length])
        with pytest.raises(FileError, match="create it again"):
            load_reduced(tmp_path / "cut.npz")


def test_a_stored_model_needs_numpy_only(models, tmp_path):
    """A program that only loads and evaluates a stored model imports no package but NumPy.

    Packages such as SciPy and pandas, and the parts of spherekit for mechanisms, files and
    positions, must not be imported. The torque is the same as in this process. `models` are
    stored models of the four-bar.
    """
    models[0].save(tmp_path / "model.npz")
    # The program prints a torque and the names of all modules that are imported by then.
    code = """import sys
from spherekit.dynamics.reduced_model import load_reduced
print(load_reduced(sys.argv[1]).torque(0.3, 1.0, 0.2, 0.1), *sys.modules)"""
    command = [sys.executable, "-c", code, str(tmp_path / "model.npz")]
    torque, *modules = subprocess.check_output(command, text=True).split()
    assert float(torque) == models[0].torque(0.3, 1.0, 0.2, 0.1)
    unneeded_parts = {
        "spherekit.mechanism.mechanism",
        "spherekit.positions",
        "spherekit.files",
    }
    assert not unneeded_parts & {*modules}
    packages = {name.split(".")[0] for name in modules}
    assert not packages & {"scipy", "pandas", "networkx", "heyoka", "rerun"}


def test_the_command_exports_a_stored_model(tmp_path, capsys):
    target = tmp_path / "m.npz"
    words = ["export", "four_bar", "--to", "model", "--poles", "3/1"]
    assert main([*words, "-o", str(target)]) == 0
    assert "functions of q" in capsys.readouterr().out
    assert load_reduced(target).heading.poles == ("3/1",)


@pytest.mark.parametrize(("unit", "given"), [("deg", "400"), ("rad", "6.981317007977318")])
def test_the_input_of_an_exported_pose_is_in_the_unit_of_the_file(unit, given, tmp_path):
    """The input 400 deg is one turn and 40 deg; angle 41 closes the loop at 40 deg."""
    path = tmp_path / "m.toml"
    target = tmp_path / "m.xml"
    path.write_text(dumps(load("four_bar"), unit))
    words = ["export", str(path), "--to", "mjcf", "-o", str(target), "--at", given]
    assert main(words) == 0
    pose = dict(re.findall(r'<joint name="(\w+)".* ref="([^"]+)"', target.read_text()))
    assert float(pose["21"]) == pytest.approx(np.radians(400.0), abs=1e-12)
    position_analysis = PositionAnalysis(load("four_bar"), assembly_mode=0)
    values = position_analysis.at(np.radians([40.0])).values[0]
    expected = np.exp(1j * values[load("four_bar").angles["41"]])
    assert np.exp(1j * float(pose["41"])) == pytest.approx(expected, abs=1e-12)


def test_functions_of_different_groups_are_refused_and_not_mixed_up(models):
    """Columns of one group would otherwise be taken from another group."""
    with pytest.raises(SolveError, match="B, rate 3/1 are not stored in one group"):
        models[0].functions(["B", "rate 3/1"], [0.3])
    assert models[0].functions([], [0.3, 0.4]).shape == (2, 0)


def test_one_coordinate_may_have_many_times_and_rates(models):
    """The load sin(t) at the crank lowers the torque that is needed by itself."""
    model = models[0]
    t = np.array([0.0, 0.5, 2.0])
    loaded = model.with_torque("sin(t)")
    difference = model.torque(0.3, 1.0, 0.0) - loaded.torque(0.3, 1.0, 0.0, t)
    assert difference == pytest.approx(np.sin(t), abs=1e-12)
    rates = np.array([1.0, 2.0])
    one_by_one = [loaded.torque(0.3, rate, 0.0, 0.5) for rate in rates.tolist()]
    assert loaded.torque(0.3, rates, 0.0, 0.5) == pytest.approx(one_by_one, rel=1e-12)


def test_accelerations_along_a_curve_are_for_one_or_many_points(models):
    """M q'' = T - T_0, checked by the torque that these accelerations need."""
    model = models[0]
    q, dq, torques = np.array([0.3, 1.4]), np.array([1.0, -2.0]), np.array([2.0, 0.5])
    accelerations = model.accelerations(q, dq, torques)
    assert accelerations.shape == (2, 1)
    assert model.torque(q, dq, accelerations[:, 0]) == pytest.approx(torques, abs=1e-12)
    single = model.accelerations(0.3, 1.0, [2.0])
    assert single == pytest.approx(accelerations[0], abs=1e-12)


@pytest.mark.slow
def test_status_outside_an_open_curve_is_out_of_reach(four_bar, models):
    limited = replace(four_bar, joint_limits=(JointLimit("21", 0.5, 4.5),))
    model = reduced_model(limited, poles=())
    status = [Status.OK, Status.OUT_OF_REACH, Status.OUT_OF_REACH, Status.OUT_OF_REACH]
    assert model.status([0.1, -1.0, 99.0, np.nan]).tolist() == status
    assert models[0].status([99.0, np.inf]).tolist() == [Status.OK, Status.OUT_OF_REACH]


def test_places_lists_the_seam_of_a_closed_curve_once(models):
    """The inputs 0 and 360 deg are one configuration."""
    assert models[0].places("theta_21", TURN) == pytest.approx([0.0], abs=1e-12)
    for value in (np.nan, np.inf):
        with pytest.raises(SolveError, match="theta_21 must be finite"):
            models[0].places("theta_21", value)


def test_a_torque_that_is_no_text_is_refused(models):
    for torque in (2.0, {"21": 1.0}):
        with pytest.raises(ModelError, match="it has to be a string, or a mapping"):
            models[0].with_torque(torque)
