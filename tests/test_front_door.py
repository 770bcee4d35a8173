"""What a new user does from `import spherekit as sk`, against values of other origin."""

import doctest
import inspect
import math
import pickle
import tomllib

import numpy as np
import pytest
from mechanism_examples.named_mechanisms import LINKS, PAIRS, four_bar_from_file
from oracles.closed_forms import (
    FOUR_BAR_ARCS,
    four_bar_angles,
    four_bar_axes,
    four_bar_coefficients,
    four_bar_frames,
)

import spherekit as sk
from spherekit.files.library import find
from spherekit.positions.position_analysis import PositionAnalysis

RECORDING = b"RRF2"


def arcs_with_crank(second):
    """Return the arcs (rad) of the four-bar of the paper, with another crank."""
    return FOUR_BAR_ARCS[0], second, *FOUR_BAR_ARCS[2:]


def closed_form_mode(kinematics, arcs):
    """Return the mode (0 or 1) of the closed form that belongs to evaluated rows.

    It is the one with the same angle at pair 41 (the rocker) at the first row.
    """
    gaps = []
    for mode in (0, 1):
        (angle,) = four_bar_angles(np.atleast_1d(kinematics.q)[:1], arcs, mode)
        first_angle = np.atleast_1d(kinematics.variable("41"))[0]
        gap = math.remainder(first_angle - angle, 2.0 * math.pi)
        gaps.append(abs(gap))
    assert min(gaps) < 1e-12 < max(gaps)
    return int(np.argmin(gaps))


def slope(function, q, h=1e-3):
    """Return the derivative of a function by a five-point stencil with step h (rad)."""
    points = [function(q + k * h) for k in (-2, -1, 1, 2)]
    return (points[0] - 8.0 * points[1] + 8.0 * points[2] - points[3]) / (12.0 * h)


@pytest.mark.parametrize("assembly_mode", [0, 1])
def test_a_changed_arc_gives_the_motion_of_the_closed_form(assembly_mode):
    """A four-bar with a crank of 25 deg moves as the closed form of Di Gregorio says.

    The file of the four-bar has a crank of 20 deg; `with_sizes` changes it. Velocity
    coefficients, angular velocities and orientations of links are compared with the closed
    form (`oracles.closed_forms`).
    `closed_form_mode` finds the assembly mode with the same rocker angle. The acceleration
    coefficient is compared with finite differences of the velocity coefficient (`slope`).
    """
    original = sk.load("four_bar")
    longer = original.with_sizes(angle_unit="deg", arcs={"2": 25.0})
    assert original.geometry.links["2"].arcs == (math.radians(20.0),)
    q = np.linspace(0.1, 2.0 * np.pi, 50)
    rows = sk.evaluate(longer, q, assembly_mode=assembly_mode)
    arcs = arcs_with_crank(math.radians(25.0))
    mode = closed_form_mode(rows, arcs)

    def rocker_coefficient(q):
        _, coefficient_41 = four_bar_coefficients(q, arcs, mode)
        return coefficient_41

    expected = rocker_coefficient(q)
    # The derivative of the angle of pair 41 by the input.
    assert rows.variable_coefficient("41") == pytest.approx(expected, abs=1e-11)
    # The pole direction of links 4 and 1 may be opposite to the axis of pair 41. The
    # coefficients then have the opposite sign.
    axis = four_bar_axes(q, arcs, mode)["41"]
    sign = np.sign(np.sum(rows.direction("41") * axis, axis=1))
    assert rows.velocity_coefficient("4/1") * sign == pytest.approx(expected, abs=1e-11)
    acceleration = rows.acceleration_coefficient("4/1") * sign
    assert acceleration == pytest.approx(slope(rocker_coefficient, q), abs=1e-8)
    rocker_velocity = axis * expected[:, None]
    assert np.max(np.abs(rows.angular_velocity("4") - rocker_velocity)) < 1e-11
    # For the coupler, two results of spherekit must agree.
    coupler_velocity = rows.velocity_coefficient("3/1")[:, None] * rows.direction("3/1")
    assert np.max(np.abs(rows.angular_velocity("3") - coupler_velocity)) < 1e-12

    # The rotation of link 4 relative to link 2. The frames of both links are the same in
    # the mechanism and in the closed form.
    frames = four_bar_frames(q, arcs, mode)
    relative = np.einsum("nji,njk->nik", rows.rotation("2"), rows.rotation("4"))
    expected_relative = np.einsum("nji,njk->nik", frames[2], frames[4])
    assert np.max(np.abs(relative - expected_relative)) < 1e-11


def test_the_table_of_evaluated_rows_has_six_poles_per_row():
    """`frame()` has the numbers of the methods; `degrees=True` converts the inputs."""
    rows = sk.evaluate("four_bar", np.linspace(0.1, 2.0 * np.pi, 50), assembly_mode=0)
    frame = rows.frame()
    assert len(frame) == 50 * 6
    assert set(frame["status"]) == {"OK"}
    pole = frame[(frame["link"] == "4") & (frame["relative_to"] == "1")]
    assert np.array_equal(pole["velocity_coefficient"], rows.velocity_coefficient("4/1"))
    assert rows.frame(degrees=True)["q"].max() == pytest.approx(360.0)


@pytest.mark.many
@pytest.mark.parametrize("name", ["four_bar", "single_flier", "roller_cam"])
def test_many_inputs_at_once_have_the_rows_of_a_run(name):
    """`sk.evaluate` at the seven inputs of a run has the rows of its table of poles."""
    mechanism = sk.load(name)
    q = np.linspace(*PositionAnalysis(mechanism).range, 7)
    order = ["assembly_mode", "sample", "link", "relative_to"]
    run_rows = sk.run(mechanism, "poles", samples=7).frame().sort_values(order)
    rows = sk.evaluate(mechanism, q).frame().sort_values(order)
    for column in ("ux", "velocity_coefficient", "acceleration_coefficient"):
        expected = run_rows[column]
        assert rows[column].to_numpy() == pytest.approx(expected, abs=1e-11, nan_ok=True)


@pytest.mark.many
@pytest.mark.parametrize("name", ["four_bar", "single_flier", "roller_cam"])
def test_one_input_alone_has_the_values_of_its_row_among_many(name):
    """Each row of many inputs equals the evaluation of its input alone.

    A pole axis has two directions, so a direction may have the opposite sign. The sign is
    chosen in the first sample of a mode and continued from there. So in sample 0 it must be
    the same as alone.
    """
    mechanism = sk.load(name)
    q = np.linspace(*PositionAnalysis(mechanism).range, 7)
    many = sk.evaluate(mechanism, q)
    for row, mode in enumerate(many.assembly_mode.tolist()):
        alone = sk.evaluate(mechanism, many.q[row], assembly_mode=mode)
        assert alone.status == many.status[row]
        assert alone.inputs == many.inputs[row]
        assert alone.assembly_mode == mode
        for link in mechanism.links:
            for method in ("rotation", "angular_velocity", "angular_velocity_dq"):
                value = getattr(alone, method)(link)
                expected = getattr(many, method)(link)[row]
                assert value == pytest.approx(expected, abs=1e-12, nan_ok=True)
        for pole in many.poles:
            cosine = many.direction(pole)[row] @ alone.direction(pole)
            assert abs(cosine) == pytest.approx(1.0, abs=1e-12, nan_ok=True)
            sign = -1.0 if cosine < 0.0 else 1.0
            assert sign > 0.0 or many.sample[row] > 0
            for method in ("velocity_coefficient", "acceleration_coefficient"):
                value = getattr(alone, method)(pole)
                expected = getattr(many, method)(pole)[row]
                assert value * sign == pytest.approx(expected, abs=1e-11, nan_ok=True)


@pytest.mark.many
@pytest.mark.parametrize("name", ["four_bar", "stephenson", "double_butterfly"])
def test_a_single_configuration_is_evaluated_without_the_plan_of_poles(name, monkeypatch):
    """One configuration is computed from expressions of floats, with the same pole.

    The function that evaluates a plan is removed, so that its use would fail. The result
    can be pickled.
    """
    mechanism, asked = sk.load(name), {"poles": ["31"], "assembly_mode": 0}
    q = sum(PositionAnalysis(mechanism).range) / 2.0 + 0.1
    with_care = sk.evaluate(mechanism, [q, q + 0.1], **asked)
    monkeypatch.delattr("spherekit.api.kinematics.evaluate_poles")
    alone = pickle.loads(pickle.dumps(sk.evaluate(mechanism, q, **asked)))
    assert alone.direction("31") == pytest.approx(with_care.direction("31")[0], abs=1e-12)


def test_a_single_configuration_has_no_axis_of_rows():
    """One input in one assembly mode gives numbers, not arrays of one row.

    Directions are then (3,) and rotations (3, 3). The first axis remains if all modes are
    asked for, or if the input is an array (1,).
    """
    alone = sk.evaluate("four_bar", 0.7, assembly_mode=0)
    rows = sk.evaluate("four_bar", [0.7], assembly_mode=0)
    modes = sk.evaluate("four_bar", 0.7)
    assert (len(alone), len(rows), len(modes)) == (1, 1, 2)
    values = {
        "q": lambda at: at.q,
        "inputs": lambda at: at.inputs,
        "sample": lambda at: at.sample,
        "assembly_mode": lambda at: at.assembly_mode,
        "status": lambda at: at.status,
        "residual": lambda at: at.residual,
        "configuration_error": lambda at: at.configuration_error,
        "variable": lambda at: at.variable("41"),
        "variable_coefficient": lambda at: at.variable_coefficient("41"),
        "rotation": lambda at: at.rotation("3"),
        "angular_velocity": lambda at: at.angular_velocity("3"),
        "angular_velocity_dq": lambda at: at.angular_velocity_dq("3"),
        "direction": lambda at: at.direction("3/1"),
        "direction_dq": lambda at: at.direction_dq("3/1"),
        "velocity_coefficient": lambda at: at.velocity_coefficient("3/1"),
        "acceleration_coefficient": lambda at: at.acceleration_coefficient("1/3"),
        "error_bound": lambda at: at.error_bound("3/1"),
        "velocity_coefficient_error_bound": (
            lambda at: at.velocity_coefficient_error_bound("3/1")
        ),
        "acceleration_coefficient_error_bound": (
            lambda at: at.acceleration_coefficient_error_bound("3/1")
        ),
        "direction_dq_error_bound": lambda at: at.direction_dq_error_bound("3/1"),
    }
    # So that no public method is forgotten here.
    public = {name for name in vars(sk.Kinematics) if not name.startswith("_")}
    assert public - {"frame", "input_pairs", "search"} == set(values)
    for name, value in values.items():
        assert np.shape(value(rows)) == (1, *np.shape(value(alone))), name
        assert np.shape(value(modes)) == (2, *np.shape(value(alone))), name
        assert value(alone) == pytest.approx(value(rows)[0], abs=1e-12), name
    assert np.ndim(alone.velocity_coefficient("3/1")) == 0
    assert alone.frame().shape == rows.frame().shape
    both = sk.evaluate("five_bar", [0.7, 0.2], assembly_mode=0)
    assert both.inputs.shape == (2,) and both.direction("3/1", "21").shape == (3,)
    assert sk.evaluate("five_bar", [[0.7, 0.2]], assembly_mode=0).inputs.shape == (1, 2)


def test_several_inputs_move_one_at_a_time():
    """With two inputs, coefficients belong to one moving input, while the other is locked.

    The coefficient of pair 43 by input 21 is compared with a central difference.
    """
    both = sk.evaluate("five_bar", [[0.3, 0.4], [0.35, 0.4]])
    alone = both.variable_coefficient("43", moving="21")
    assert both.inputs.shape == (4, 2) and list(both.sample) == [0, 1, 0, 1]
    step = 1e-5
    beside = [sk.evaluate("five_bar", [0.3 + k * step, 0.4]) for k in (-1, 1)]
    change = (beside[1].variable("43") - beside[0].variable("43")) / (2.0 * step)
    assert alone[both.sample == 0] == pytest.approx(change, abs=1e-8)
    with pytest.raises(sk.SpherekitError, match="the input that moves. Inputs: 21, 51"):
        both.velocity_coefficient("3/1")


@pytest.mark.parametrize("name", sk.mechanisms())
def test_a_file_and_the_same_data_in_code_are_one_mechanism(name):
    """`sk.build` with the data of a file gives the mechanism of the file."""
    data = tomllib.loads(find(name).read_text(encoding="utf-8"))
    data.pop("format")
    mechanism = sk.load(name)
    assert sk.build(**data) == mechanism
    assert len(repr(mechanism)) < 200 and name in repr(mechanism)


def test_a_mechanism_without_a_file():
    """A four-bar built in code moves like that of the file.

    With the crank's axes as (lon, lat) its arcs are rounded to 1e-7; with arcs it is exact.
    """
    posed = four_bar_from_file(inputs={"drive": (0, 360)})
    rows, expected = sk.evaluate(posed, [0.2, 0.7]), sk.evaluate("four_bar", [0.2, 0.7])
    assert rows.variable("hinge") == pytest.approx(expected.variable("41"), abs=1e-7)
    exact = four_bar_from_file(
        links={**LINKS, "crank": {"axes": ["drive", "tip"], "arcs": [20]}}
    )
    rows = sk.evaluate(exact, [0.2, 0.7])
    assert rows.variable("hinge") == pytest.approx(expected.variable("41"), abs=1e-14)


def test_a_mechanism_built_by_axes_stands_in_its_pose_at_zero():
    """A mechanism that is stated by its axes in a pose stands in this pose at input 0.

    All links then have the identity as their rotation. Axes are stated by longitude and
    latitude (deg). `with_sizes` changes an axis, and the angle that a pair has in the pose.
    """
    links = ["base", "crank", "coupler", "rocker"]
    lonlat = {"drive": (0, 90), "tip": (90, 70), "joint": (20, 15), "hinge": (70, 30)}
    # In `PAIRS` the entry of the hinge is a dictionary, the others are lists of links.
    pair_links = {**PAIRS, "hinge": PAIRS["hinge"]["links"]}
    pairs = {
        name: {"links": pair_links[name], "lonlat": axis} for name, axis in lonlat.items()
    }
    posed = four_bar_from_file(links=links, pairs=pairs, inputs="drive")
    row = sk.evaluate(posed, 0.0, assembly_mode=0)
    for link in links:
        assert np.max(np.abs(row.rotation(link) - np.eye(3))) < 1e-14
    changed = posed.with_sizes(
        angle_unit="deg", axes={"hinge": [0, 2, 1]}, values={"tip": 30}
    )
    expected_axis = np.array([0, 2, 1]) / math.sqrt(5)
    assert changed.geometry.axes["hinge"] == pytest.approx(expected_axis)
    assert changed.geometry.values["tip"] == math.radians(30.0)


def test_gears_built_in_code_turn_by_their_teeth():
    """Bevel wheels of 20 and 40 teeth, built in code, turn at the ratio -1/2.

    The variable coefficient is the rate of the second wheel per rate of the input, the
    first wheel. It is negative since wheels in external contact turn in opposite senses.
    """
    gears = sk.build(
        "gears",
        angle_unit="deg",
        ground="g",
        links=["g", "a", "b"],
        pairs={
            "one": {"links": ["g", "a"], "xyz": [0, 0, 1]},
            "two": {"links": ["g", "b"], "xyz": [1, 0, 0]},
            "mesh": {
                "type": "Cr",
                "links": ["a", "b"],
                "teeth": [20, 40],
                "axes": ["one", "two"],
            },
        },
        inputs="one",
    )
    assert sk.evaluate(gears, 0.1).variable_coefficient("two") == pytest.approx([-0.5])


def test_changes_by_methods_are_changes_of_the_file():
    """Changes of a mechanism by its methods `with_...` equal changes of its file.

    The same sizes, inputs, masses and loads are changed in the data of the file, from which
    a second mechanism is built.
    """
    data = tomllib.loads(find("four_bar").read_text(encoding="utf-8"))
    data.pop("format")
    tensor = np.diag([4.0, 4.0, 1.0])
    data["links"]["3"]["arcs"] = [71.5]
    data["pairs"]["41"]["zero"] = 17.0
    data["inputs"]["21"] = {"from": 10.0, "to": 50.0}
    data["mass"]["4"] = {"tensor": tensor, "mass": 3, "centre": [0, 0, 0.1]}
    data["loads"].pop("on_crank")
    data["loads"]["coil"] = {"kind": "spring", "pair": "21", "stiffness": 2, "rest": 90.0}
    changed = (
        sk.load("four_bar")
        .with_sizes(angle_unit="deg", arcs={"3": {"43": 71.5}}, zeros={"41": 17.0})
        .with_inputs(ranges={"21": (10.0, 50.0)}, angle_unit="deg")
        .with_mass("4", tensor, 3.0, (0, 0, 0.1))
        .with_loads(sk.Spring("coil", "21", 2.0, math.pi / 2), without=["on_crank"])
    )
    assert changed == sk.build(**data)
    assert len(changed.with_mass("4", None).masses) == 2


@pytest.mark.parametrize(
    "arc", [25, np.float32(25.0), [25.0], np.array([25.0]), {"32": 25.0}], ids=repr
)
def test_an_arc_is_a_number_a_list_or_by_pair(arc):
    """A link's arc (deg) may be any number, a list of one, or stated by its pair."""
    changed = sk.load("four_bar").with_sizes(angle_unit="deg", arcs={"2": arc})
    assert changed.geometry.links["2"].arcs == (math.radians(25.0),)


def test_a_new_input_has_a_range_of_one_turn():
    """A pair that becomes the input is driven from 0 to 2 pi."""
    assert sk.load("four_bar").with_inputs("41").inputs[0].stop == 2.0 * math.pi


def test_a_torque_is_a_number_a_text_or_a_function():
    """A constant torque as a number, a text or a function gives the same motion.

    The same function as the torque of a load of the mechanism gives this motion, too. Each
    motion lasts 0.5 s.
    """
    start = sk.Start(0.3, 1.0)

    def angle_after_half_a_second(torque):
        result = sk.simulate("four_bar", start, 0.5, torque=torque, engine="numpy")
        return result.at([0.5]).q[0]

    by_number = angle_after_half_a_second(2.5)
    by_function = angle_after_half_a_second(lambda t, q, dq: 2.5)
    assert angle_after_half_a_second("2.5") == by_number
    assert by_function == pytest.approx(by_number, abs=1e-12)
    load = sk.PairTorque("motor", "21", lambda t, q, dq: 2.5)
    loaded = sk.load("four_bar").with_loads(load)
    by_load = sk.simulate(loaded, start, 0.5).at([0.5]).q[0]
    assert by_load == pytest.approx(by_number, abs=1e-12)
    # A built-in function without a signature is accepted; the motion does not matter.
    sk.simulate("four_bar", start, 0.1, torque=max)


def test_a_torque_that_jumps_unforeseen_is_found():
    """A torque that jumps inside a Python function is integrated exactly across the jump.

    A bang-bang controller is compared with two runs that each see one side of the jump.
    """
    start, half, how = sk.Start(0.3, 1.0), 0.437, {"engine": "numpy"}
    jumping = sk.simulate(
        "four_bar", start, 1.0, torque=lambda t, q, dq: 5.0 if t < half else -5.0
    )
    first = sk.simulate("four_bar", start, half, torque=5.0, **how).at([half])
    on = sk.Start(float(first.q[0]), float(first.dq[0]))
    then = sk.simulate("four_bar", on, 1.0 - half, torque=-5.0, **how)
    assert jumping.at([1.0]).q[0] == pytest.approx(then.at([1.0 - half]).q[0], abs=1e-7)


def test_an_over_constrained_mechanism_has_a_plan_and_a_notebook_table():
    """Counting gives the Miura unit no mobility; by the rank of its equations it has one.

    A mechanism whose inputs are too many by both is refused.
    """
    plan = sk.plan("miura_unit")
    assert len(plan.pass_numbers) == 36 and "Pole table of miura_unit" in plan._repr_html_()
    assert sk.plan("miura_unit", iter(["f33/f11"])).pass_numbers
    with pytest.raises(sk.SpherekitError, match="= 1, but the number of inputs is 2"):
        sk.plan(sk.load("four_bar").with_inputs("21", "41"))


def test_objects_show_themselves_in_a_line():
    """The text (`repr`) of each public object is one line with its class and mechanism."""
    mechanism = sk.load("four_bar")
    shown = {
        "Mechanism": mechanism,
        "Plan": sk.plan(mechanism),
        "Motion": sk.trace(mechanism, samples=5),
        "RunResult": sk.run(mechanism, samples=5),
        "Simulation": sk.simulate(mechanism, sk.Start(0.3), 0.1, engine="numpy"),
        "Kinematics": sk.evaluate(mechanism, 0.3),
        "InverseSolution": sk.inverse_dynamics(mechanism, sk.ConstantSpeed(1.0), [0, 1]),
    }
    for name, each in shown.items():
        assert repr(each).startswith(f"<{name} ") and "four_bar" in repr(each)
        assert len(repr(each)) < 200 and "\n" not in repr(each)
    assert "spherekit: agile_eye, bevel" in repr(sk.mechanisms())


def test_the_example_in_the_help_of_the_package_runs(tmp_path, monkeypatch, capsys):
    """The example in the docstring of `spherekit` runs as it stands.

    It evaluates a four-bar with a crank of 25 deg at one input (`here`) and at 50 inputs
    (`turn`), builds a mechanism (`made`), computes a motion (`motion`), simulates
    (`falling`), and runs an analysis (`result`). Coefficients are compared with the closed
    form, without their sign, because an axis has two directions.
    """
    pytest.importorskip("matplotlib")
    monkeypatch.chdir(tmp_path)
    names = {}
    exec(sk.__doc__[sk.__doc__.index("import numpy") :], names)
    # The printed plan says how poles (axes of relative rotation) of two links are found.
    # This is the row of link 1, with columns for the links 1 to 4. An "x" stands for a pole
    # that is the axis of a pair, and an "I" for a pole that the first pass finds.
    assert "1  ■  x  I  x" in capsys.readouterr().out
    row = names["here"]
    rows = names["turn"]
    arcs = arcs_with_crank(math.radians(25.0))
    # The closed form numbers modes in its own way. `closed_form_mode` returns this number.
    _, expected_at_rows = four_bar_coefficients(rows.q, arcs, closed_form_mode(rows, arcs))
    assert len(rows.q) == 50
    coefficients = rows.velocity_coefficient("4/1")  # of link 4 relative to link 1
    assert np.abs(coefficients) == pytest.approx(np.abs(expected_at_rows))
    _, expected_at_row = four_bar_coefficients(row.q, arcs, closed_form_mode(row, arcs))
    assert np.abs(row.velocity_coefficient("4/1")) == pytest.approx(np.abs(expected_at_row))
    assert names["made"].name == "wrist"
    assert len(names["motion"]) == 2 * 361  # two assembly modes
    figure = names["result"].plot("velocity coefficients")
    assert any(len(line.get_xdata()) == 361 for line in figure.axes[0].lines)
    assert (tmp_path / "four_bar.rrd").read_bytes()[:4] == RECORDING
    with pytest.raises(sk.SpherekitError, match=r"a recording is a file named \*.rrd"):
        names["result"].save(tmp_path / "four_bar.csv")
    assert names["falling"].at([5.0]).q.shape == (1,)


def documented():
    """Yield the public functions and methods whose help has an example."""
    for name in sk.__all__:
        value = getattr(sk, name)
        parts = [(name, value)]
        if inspect.isclass(value):
            parts += [(f"{name}.{key}", item) for key, item in vars(value).items()]
        for key, item in parts:
            if inspect.isroutine(item) and ">>>" in (inspect.getdoc(item) or ""):
                yield key, item


DOCUMENTED = dict(documented())
NEEDS = {"import_mechanism": "mujoco", "RunResult.plot": "matplotlib"}


@pytest.mark.many(slow="all")
@pytest.mark.parametrize("name", DOCUMENTED)
def test_the_examples_of_help_do_what_they_say(name, tmp_path, monkeypatch):
    """Every example in the help of a public function prints what is written there."""
    if name in NEEDS:
        pytest.importorskip(NEEDS[name])
    monkeypatch.chdir(tmp_path)
    item = inspect.unwrap(DOCUMENTED[name])
    (test,) = doctest.DocTestFinder(recurse=False).find(item, name, globs={})
    runner = doctest.DocTestRunner(optionflags=doctest.NORMALIZE_WHITESPACE)
    assert test.examples and runner.run(test).failed == 0


def test_what_a_notebook_starts_with_has_an_example():
    functions = "load", "build", "mechanisms", "plan", "evaluate", "simulate", "export"
    changes = (f"Mechanism.with_{each}" for each in ("sizes", "inputs", "mass", "loads"))
    assert {*functions, *changes} <= DOCUMENTED.keys()


NAMED = [
    lambda m: sk.plan(m).steps,
    lambda m: len(sk.trace(m, samples=3)),
    lambda m: sk.evaluate(m, [0.3, 0.4]).inputs.shape,
    lambda m: len(sk.run(m, samples=3).frame()),
    lambda m: sk.ForwardKinematics(m).mechanism.name,
    lambda m: sk.InverseKinematics(m).own.name,
]


@pytest.mark.parametrize("ask", NAMED, ids=range(len(NAMED)))
def test_a_mechanism_is_given_as_such_by_name_or_by_path(ask):
    mechanism = sk.load("five_bar")
    assert ask("five_bar") == ask(mechanism) == ask(find("five_bar"))
