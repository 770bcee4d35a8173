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


def arcs_of(second):
    return FOUR_BAR_ARCS[0], second, *FOUR_BAR_ARCS[2:]


def mode_of(here, arcs):
    """The mode of the closed form that an assembly mode at its first row is in."""
    off = [
        abs(math.remainder(here.variable("41")[0] - angle, 2.0 * math.pi))
        for mode in (0, 1)
        for angle in four_bar_angles(here.q[:1], arcs, mode)
    ]
    assert min(off) < 1e-12 < max(off)
    return int(np.argmin(off))


def slope(function, q, h=1e-3):
    """The derivative of a function by a five-point stencil."""
    points = [function(q + k * h) for k in (-2, -1, 1, 2)]
    return (points[0] - 8.0 * points[1] + 8.0 * points[2] - points[3]) / (12.0 * h)


@pytest.mark.parametrize("assembly_mode", [0, 1])
def test_load_change_an_arc_and_sweep(assembly_mode):
    second = math.radians(25.0)
    longer = sk.load("four_bar").with_sizes(angle_unit="deg", arcs={"2": 25.0})
    assert sk.load("four_bar").geometry.links["2"].arcs == (math.radians(20.0),)
    turn = sk.evaluate(
        longer, np.linspace(0.1, 2.0 * np.pi, 50), assembly_mode=assembly_mode
    )
    arcs = arcs_of(second)
    mode = mode_of(turn, arcs)

    def coefficient(q):
        return four_bar_coefficients(q, arcs, mode)[1]

    wanted = coefficient(turn.q)
    assert turn.variable_coefficient("41") == pytest.approx(wanted, abs=1e-11)
    axis = four_bar_axes(turn.q, arcs, mode)
    sense = np.sign(np.sum(turn.direction("41") * axis["41"], axis=1))
    assert turn.velocity_coefficient("4/1") * sense == pytest.approx(wanted, abs=1e-11)
    derivative = turn.acceleration_coefficient("4/1") * sense
    assert derivative == pytest.approx(slope(coefficient, turn.q), abs=1e-8)
    w = axis["41"] * wanted[:, None]
    assert np.max(np.abs(turn.angular_velocity("4") - w)) < 1e-11
    turned = np.einsum("n,nj->nj", turn.velocity_coefficient("3/1"), turn.direction("3/1"))
    assert np.max(np.abs(turn.angular_velocity("3") - turned)) < 1e-12
    frames = four_bar_frames(turn.q, arcs, mode)
    relative = np.einsum("nji,njk->nik", turn.rotation("2"), turn.rotation("4"))
    known = np.einsum("nji,njk->nik", frames[2], frames[4])
    # link 4 lists pair 43 first, as its frame in the source has it
    assert np.max(np.abs(relative - known)) < 1e-11
    frame = turn.frame()
    own = frame[(frame["link"] == "4") & (frame["relative_to"] == "1")]
    assert len(frame) == 50 * 6 and set(frame["status"]) == {"OK"}
    assert np.array_equal(own["velocity_coefficient"], turn.velocity_coefficient("4/1"))
    assert turn.frame(degrees=True)["q"].max() == pytest.approx(360.0)


@pytest.mark.many
@pytest.mark.parametrize("name", ["four_bar", "single_flier", "roller_cam"])
def test_one_input_is_a_row_of_many_and_a_row_of_a_run(name):
    mechanism = sk.load(name)
    q = np.linspace(*PositionAnalysis(mechanism).range, 7)
    many = sk.evaluate(mechanism, q)
    by = ["assembly_mode", "sample", "link", "relative_to"]
    run = sk.run(mechanism, "poles", samples=7).frame().sort_values(by)
    here = many.frame().sort_values(by)
    for column in ("ux", "velocity_coefficient", "acceleration_coefficient"):
        assert here[column].to_numpy() == pytest.approx(run[column], abs=1e-11, nan_ok=True)
    for row, mode in enumerate(many.assembly_mode.tolist()):
        one = sk.evaluate(mechanism, many.q[row], assembly_mode=mode)
        assert one.status[0] == many.status[row]
        assert one.inputs[0] == many.inputs[row] and one.assembly_mode[0] == mode
        for link in mechanism.links:
            for read in ("rotation", "angular_velocity", "angular_velocity_dq"):
                values, wanted = (getattr(x, read)(link) for x in (one, many))
                assert values[0] == pytest.approx(wanted[row], abs=1e-12, nan_ok=True)
        for pole in many.poles:
            sense = many.direction(pole)[row] @ one.direction(pole)[0]
            assert abs(sense) == pytest.approx(1.0, abs=1e-12, nan_ok=True)
            sense = -1.0 if sense < 0.0 else 1.0  # it goes on along the rows of a mode
            assert sense > 0.0 or many.sample[row] > 0
            for read in ("velocity_coefficient", "acceleration_coefficient"):
                value, wanted = getattr(one, read)(pole)[0], getattr(many, read)(pole)[row]
                assert value * sense == pytest.approx(wanted, abs=1e-11, nan_ok=True)


@pytest.mark.many
@pytest.mark.parametrize("name", ["four_bar", "stephenson", "double_butterfly"])
def test_one_row_of_a_mode_is_found_by_terms_of_floats(name, monkeypatch):
    mechanism, asked = sk.load(name), {"poles": ["31"], "assembly_mode": 0}
    q = sum(PositionAnalysis(mechanism).range) / 2.0 + 0.1
    with_care = sk.evaluate(mechanism, [q, q + 0.1], **asked)
    monkeypatch.delattr("spherekit.api.kinematics.evaluate_poles")
    one = pickle.loads(pickle.dumps(sk.evaluate(mechanism, q, **asked)))
    assert one.direction("31")[0] == pytest.approx(with_care.direction("31")[0], abs=1e-12)


def test_several_inputs_move_one_at_a_time():
    both = sk.evaluate("five_bar", [[0.3, 0.4], [0.35, 0.4]])
    alone = both.variable_coefficient("43", moving="21")
    assert both.inputs.shape == (4, 2) and list(both.sample) == [0, 1, 0, 1]
    step = 1e-5
    beside = [sk.evaluate("five_bar", [0.3 + k * step, 0.4]) for k in (-1, 1)]
    change = (beside[1].variable("43") - beside[0].variable("43")) / (2.0 * step)
    assert alone[both.sample == 0] == pytest.approx(change, abs=1e-8)
    with pytest.raises(sk.SpherekitError, match="say which input moves; inputs: 21, 51"):
        both.velocity_coefficient("3/1")


@pytest.mark.parametrize("name", sk.mechanisms())
def test_a_file_and_the_same_data_in_code_are_one_mechanism(name):
    data = tomllib.loads(find(name).read_text(encoding="utf-8"))
    data.pop("format")
    mechanism = sk.load(name)
    assert sk.build(**data) == mechanism
    assert len(repr(mechanism)) < 200 and name in repr(mechanism)


def test_a_mechanism_without_a_file():
    made = four_bar_from_file(inputs={"drive": (0, 360)})
    one, other = sk.evaluate(made, [0.2, 0.7]), sk.evaluate("four_bar", [0.2, 0.7])
    assert one.variable("hinge") == pytest.approx(other.variable("41"), abs=1e-7)
    exact = four_bar_from_file(
        links={**LINKS, "crank": {"axes": ["drive", "tip"], "arcs": [20]}}
    )
    one = sk.evaluate(exact, [0.2, 0.7])
    assert one.variable("hinge") == pytest.approx(other.variable("41"), abs=1e-14)


def test_the_same_by_axes_and_contacts():
    names = ["base", "crank", "coupler", "rocker"]
    axes = {"drive": (0, 90), "tip": (90, 70), "joint": (20, 15), "hinge": (70, 30)}
    ends = {**PAIRS, "hinge": PAIRS["hinge"]["links"]}
    posed = four_bar_from_file(
        links=names,
        pairs={n: {"links": ends[n], "lonlat": axes[n]} for n in axes},
        inputs="drive",
    )
    here = sk.evaluate(posed, 0.0, assembly_mode=0)
    for name in names:
        assert np.max(np.abs(here.rotation(name) - np.eye(3))) < 1e-14
    moved = posed.with_sizes(
        angle_unit="deg", axes={"hinge": [0, 2, 1]}, values={"tip": 30}
    )
    assert moved.geometry.axes["hinge"] == pytest.approx(np.array([0, 2, 1]) / math.sqrt(5))
    assert moved.geometry.values["tip"] == math.radians(30.0)
    mesh = {"type": "Cr", "links": ["a", "b"], "teeth": [20, 40], "axes": ["one", "two"]}
    axles = {"one": ("a", [0, 0, 1]), "two": ("b", [1, 0, 0])}
    pairs = {n: {"links": ["g", to], "xyz": axis} for n, (to, axis) in axles.items()}
    gears = sk.build(
        "gears",
        angle_unit="deg",
        ground="g",
        links=["g", "a", "b"],
        pairs={**pairs, "mesh": mesh},
        inputs="one",
    )
    assert sk.evaluate(gears, 0.1).variable_coefficient("two") == pytest.approx([-0.5])


def test_changes_are_those_of_the_file():
    four_bar = sk.load("four_bar")
    text = find("four_bar").read_text(encoding="utf-8")
    data = tomllib.loads(text)
    data.pop("format")
    data["links"]["3"]["arcs"] = [71.5]
    data["pairs"]["41"]["zero"] = 17.0
    data["inputs"]["21"] = {"from": 10.0, "to": 50.0}
    tensor = np.diag([4.0, 4.0, 1.0])
    data["mass"]["4"] = {"tensor": tensor, "mass": 3, "centre": [0, 0, 0.1]}
    data["loads"].pop("on_crank")
    data["loads"]["coil"] = {"kind": "spring", "pair": "21", "stiffness": 2, "rest": 90.0}
    changed = (
        four_bar.with_sizes(angle_unit="deg", arcs={"3": {"43": 71.5}}, zeros={"41": 17.0})
        .with_inputs(ranges={"21": (10.0, 50.0)}, angle_unit="deg")
        .with_mass("4", tensor, 3.0, (0, 0, 0.1))
        .with_loads(sk.Spring("coil", "21", 2.0, math.pi / 2), without=["on_crank"])
    )
    assert changed == sk.build(**data) and len(changed.with_mass("4", None).masses) == 2
    for one in (25, np.float32(25.0), [25.0], np.array([25.0]), {"32": 25.0}):
        arcs = (
            four_bar.with_sizes(angle_unit="deg", arcs={"2": one}).geometry.links["2"].arcs
        )
        assert arcs == (math.radians(25.0),)
    assert four_bar.with_inputs("41").inputs[0].stop == 2.0 * math.pi


def test_a_torque_is_a_number_a_text_or_a_function():
    start = sk.Start(0.3, 1.0)
    given = (2.5, "2.5", lambda t, q, dq: 2.5)
    ends = [
        sk.simulate("four_bar", start, 0.5, torque=each, engine="numpy").at([0.5]).q[0]
        for each in given
    ]
    assert ends[1] == ends[0] and ends[2] == pytest.approx(ends[0], abs=1e-12)
    load = sk.PairTorque("motor", "21", lambda t, q, dq: 2.5)
    held = sk.load("four_bar").with_loads(load)
    assert sk.simulate(held, start, 0.5).at([0.5]).q[0] == pytest.approx(ends[0], abs=1e-12)
    sk.simulate("four_bar", start, 0.1, torque=max)  # such builtins have no signature


def test_a_torque_that_jumps_unforeseen_is_found():
    """A bang-bang controller: the same as two runs that each see one side of the jump."""
    start, half, how = sk.Start(0.3, 1.0), 0.437, {"engine": "numpy"}
    jumping = sk.simulate(
        "four_bar", start, 1.0, torque=lambda t, q, dq: 5.0 if t < half else -5.0
    )
    first = sk.simulate("four_bar", start, half, torque=5.0, **how).at([half])
    on = sk.Start(float(first.q[0]), float(first.dq[0]))
    then = sk.simulate("four_bar", on, 1.0 - half, torque=-5.0, **how)
    assert jumping.at([1.0]).q[0] == pytest.approx(then.at([1.0 - half]).q[0], abs=1e-7)


def test_objects_show_themselves_in_a_line():
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


def test_the_help_of_the_package_leads_to_everything_at_the_first_attempt(
    tmp_path, monkeypatch, capsys
):
    """Its lines run as they stand, and give what the closed form does."""
    pytest.importorskip("matplotlib")
    monkeypatch.chdir(tmp_path)
    names = {}
    exec(sk.__doc__[sk.__doc__.index("import numpy") :], names)
    assert "1  ■  x  I  x" in capsys.readouterr().out
    here, turn, arcs = names["here"], names["turn"], arcs_of(math.radians(25.0))
    wanted = four_bar_coefficients(turn.q, arcs, mode_of(turn, arcs))[1]
    assert len(turn.q) == 50
    assert np.abs(turn.velocity_coefficient("4/1")) == pytest.approx(np.abs(wanted))
    alone = four_bar_coefficients(here.q, arcs, mode_of(here, arcs))[1]
    assert np.abs(here.velocity_coefficient("4/1")) == pytest.approx(np.abs(alone))
    assert len(names["motion"]) == 2 * 361 and names["made"].name == "wrist"
    figure = names["result"].plot("velocity coefficients")
    assert any(len(line.get_xdata()) == 361 for line in figure.axes[0].lines)
    assert (tmp_path / "four_bar.rrd").read_bytes()[:4] == RECORDING
    with pytest.raises(sk.SpherekitError, match=r"a recording is a file named \*.rrd"):
        names["result"].save(tmp_path / "four_bar.csv")
    assert names["falling"].at([5.0]).q.shape == (1,)


def documented():
    """The public functions and methods whose help has an example."""
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


@pytest.mark.many
@pytest.mark.parametrize("name", DOCUMENTED)
def test_the_examples_of_help_do_what_they_say(name, tmp_path, monkeypatch):
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
