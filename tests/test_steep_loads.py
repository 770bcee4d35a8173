"""Loads that change at once, by both engines against closed forms and Newton and Euler."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from helpers.engines import ENGINES
from mechanism_examples.named_mechanisms import one_link_mechanism as linked
from oracles.newton_euler import check_simulated_motion, with_point_masses

from spherekit.cli.main import FAILED_SAMPLES, main
from spherekit.dynamics.forward_dynamics import simulate
from spherekit.errors import EngineError, SolveError
from spherekit.files.mechanism_reader import load
from spherekit.files.mechanism_writer import dump
from spherekit.files.study import Start
from spherekit.mechanism.load_kinds import Friction, JointLimit, PairTorque
from spherekit.symbolic.compiler import available

START = Start(0.3, 1.0)
RUBBED = [
    ("four_bar", ("43", "21"), 0.5, 0.2),
    ("stephenson", ("35", "14"), 0.05, 0.2),
    ("roller_cam", ("cam_shaft", "follower_pivot"), 0.01, 0.2),
    ("four_bar", ("43", "21"), 0.5, 6.0),
]


@pytest.mark.slow
@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize(("name", "rubbing", "speed", "dry"), RUBBED)
def test_dry_friction_is_that_of_newton_and_euler(name, rubbing, speed, dry, engine):
    """That of up to 6 N m holds against 10 sin 2t N m, lets go, and holds again."""
    made = replace(load(name), loads=()) if name == "four_bar" else with_point_masses(name)
    made = made.with_inputs(made.inputs[0].pair if made.inputs else "21")
    drive, speed = f"10*sin(2*t) - 2*dtheta_{made.inputs[0].pair}", np.deg2rad(speed)
    rubs = [Friction(f"rub_{pair}", pair, dry, 0.0, speed) for pair in rubbing]
    made = replace(made, loads=(PairTorque("drive", made.inputs[0].pair, drive), *rubs))
    found = simulate(made, START, 2.0, engine=engine, check=True)
    assert found.end.kind == "time" and found.missed is None

    def driving(t, rates):
        return [10.0 * np.sin(2.0 * t) - 2.0 * rates[0]]

    check_simulated_motion(
        found, driving, speed=speed, within=1e-7, dry=dict.fromkeys(rubbing, dry)
    )
    rates = found.at(np.linspace(0.0, 2.0, 201)).dq
    assert dry < 1.0 or np.min(np.abs(rates)) < 1e-3 < np.max(np.abs(rates))


# --- closed forms on one link ------------------------------------------------------------

INERTIA = 0.75


one_link = partial(linked, np.diag([INERTIA, 0.5, 0.5]))


def torque(text):
    """Return a torque at its pair."""
    return PairTorque("torque", "12", text)


WIDE, NARROW = 1e-3, 1e-6
IMPULSES = {
    "bump": ("{high}*exp(-((t - 1.37)/{w})**2)", np.sqrt(np.pi)),
    "bell": ("{high}*(1 - tanh((t - 1.37)/{w})**2)", 2.0),
    "root": ("{high}*(1 + ((t - 1.37)/{w})**2)**(-1.5)", 2.0),
    "hat": ("{high}*max(0, 1 - abs(t - 1.37)/{w})", 1.0),
    "box": ("{high}*(sign(t - 1.37 + {w}) - sign(t - 1.37 - {w}))", 4.0),
}


@pytest.mark.many
@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize("width", [pytest.param(WIDE, marks=pytest.mark.slow), NARROW])
@pytest.mark.parametrize("kind", IMPULSES)
def test_an_impulse_however_short_changes_the_momentum(kind, width, engine):
    """By its integral, less what one leaves out that is never zero; or the run ends there.

    NumPy ends at jumps that no step is short enough for, and says so.
    """
    text, area = IMPULSES[kind]
    high = 0.1 / width
    made = one_link(torque(text.format(high=repr(high), w=repr(width))))
    found = simulate(made, Start(0.0, 1.0), 2.0, engine=engine)
    if engine == "numpy" and kind == "box" and found.end.kind == "too_fast":
        assert abs(found.end.t - 1.37) < 2.0 * width and "jumps" in found.end.message
        return
    rate = found.at([2.0]).dq[0]
    left_out = 0.0
    if kind == "root":
        left_out = sum(1.0 - x / np.hypot(1.0, x) for x in (1.37 / width, 0.63 / width))
    assert abs(rate - 1.0 - 0.1 * (area - left_out) / INERTIA) < 1e-8
    assert found.missed is None


@pytest.mark.many
@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize("sense", [1.0, -1.0])
def test_a_narrow_step_of_the_potential_changes_the_energy(sense, engine):
    """A torque F (1 - tanh((theta - a)/w)^2) does the work 2 F w."""
    width, work = 1e-6, sense * 0.2
    high = work / (2.0 * width)
    text = f"{high!r}*(1 - tanh((theta_12 - 0.8)/{width!r})**2)"
    found = simulate(one_link(torque(text)), Start(0.0, 1.0), 1.7, engine=engine)
    assert abs(found.at([1.7]).dq[0] - np.sqrt(1.0 + 2.0 * work / INERTIA)) < 1e-8


@pytest.mark.many
@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize(
    "speed", [1e-3, *(pytest.param(x, marks=pytest.mark.slow) for x in (1e-2, 0.1))]
)
def test_friction_stops_a_link_and_holds_it(speed, engine):
    """J w' = -F tanh(w / s): sinh(w / s) falls as exp(-F t / (J s)) does."""
    made = one_link(Friction("rub", "12", 2.0, 0.0, speed))
    found = simulate(made, Start(0.0, 1.0), 1.0, engine=engine, check=True)
    t = np.array([0.1, 0.3, 0.37, 0.375, 0.38, 0.5, 1.0])
    # ln sinh(1 / s) and its inverse, so that sinh need not be held by a float64.
    start = 1.0 / speed + np.log1p(-np.exp(-2.0 / speed)) - np.log(2.0)
    level = start - 2.0 * t / (INERTIA * speed)
    large = level + np.log(2.0)
    expected = speed * np.where(
        level > 20.0, large, np.arcsinh(np.exp(np.minimum(level, 20)))
    )
    assert np.max(np.abs(found.at(t).dq - expected)) < 1e-8
    assert found.missed is None


@pytest.mark.parametrize("engine", ENGINES)
def test_a_stop_that_is_touched_ends_the_motion(engine):
    """q = t - t^2 / 2 rises to 1/2, 1e-9 above the stop."""
    made = one_link(
        torque(repr(-INERTIA)), joint_limits=(JointLimit("12", -1.0, 0.5 - 1e-9),)
    )
    found = simulate(made, Start(0.0, 1.0), 3.0, engine=engine)
    assert found.end.kind == "joint_limit"
    assert abs(found.end.t - (1.0 - np.sqrt(2e-9))) < 1e-9


@pytest.mark.many
@pytest.mark.parametrize("engine", ENGINES)
def test_the_command_says_that_a_tolerance_is_missed(engine, tmp_path, capsys):
    """On its way into a saddle; for a second it gets there, for seven it does not."""
    path = tmp_path / "saddle.toml"
    dump(one_link(torque(repr(16.0 * INERTIA) + "*theta_12")), path)

    def asked(seconds, *words):
        start = ["--start", "q=1,dq=-4", "--duration", seconds, "--engine", engine]
        status = main(["run", str(path), "-a", "eksergian", *start, *words])
        said = capsys.readouterr()
        return status, said.out, said.err

    status, out, err = asked("1", "--strict")
    assert status == 0 and "at tolerance 1.0e-09, energy" in out and "misses" not in err
    for words, expected in (((), 0), (("--strict",), FAILED_SAMPLES)):
        status, out, err = asked("7", *words)
        assert status == expected
        assert "at tolerance 1.0e-09 (MISSED), energy" in out
        assert "warning: the simulation misses its tolerance of 1.0e-09 rad" in out + err


@pytest.mark.parametrize("engine", ENGINES)
def test_masses_and_loads_of_any_size_give_the_same_motion(engine):
    """Scaled together they give the same equation, and as good an answer."""
    ends = []
    for scale in (1.0, 2.0**-40):
        made = one_link(torque(f"{scale!r}*10*sin(2*t) - {scale!r}*theta_12**3"))
        masses = tuple(
            replace(m, tensor=tuple(tuple(scale * x for x in row) for row in m.tensor))
            for m in made.masses
        )
        given = replace(made, masses=masses)
        ends.append(simulate(given, Start(0.3, 1.0), 5.0, engine=engine).at([5.0]).q[0])
    assert abs(ends[0] - ends[1]) < 1e-9


@pytest.mark.parametrize("engine", ENGINES)
def test_an_inertia_that_vanishes_is_the_reason(engine):
    """Where a rocker that alone has mass turns back, nothing with mass moves."""
    made = load("four_bar")
    rocker = tuple(mass for mass in made.masses if mass.link == "4")
    light = replace(made, masses=rocker, loads=())
    found = simulate(light, START, 10.0, engine=engine)
    assert found.end.kind == "no_inertia" and "equivalent inertia" in found.end.message
    # The crank and the coupler are one arc there, of 70 - 20 or 70 + 20 degrees.
    c, s = np.cos(np.radians([40.0, 60.0])), np.sin(np.radians([40.0, 60.0]))
    rocking = (np.cos(np.radians([50.0, 90.0])) - c[0] * c[1]) / (s[0] * s[1])
    angle = found.at([found.end.t]).values[0, made.variable_names.index("theta_41")]
    assert np.min(np.abs(abs(np.cos(angle)) - np.abs(rocking))) < 1e-4


@pytest.mark.parametrize("engine", ENGINES)
def test_a_link_with_mass_that_stands_still_is_no_inertia(engine):
    """A four-bar of right angles folds: links 3 and 4 turn about 41, or all three do."""
    arcs = {"1": 90.0, "2": 90.0 - 1e-9, "3": 90.0, "4": 90.0}
    made = load("four_bar").with_sizes(angle_unit="deg", arcs=arcs).with_inputs("41")
    crank = tuple(mass for mass in made.masses if mass.link == "2")
    folding = replace(made, masses=crank, loads=())
    with pytest.raises(SolveError, match="no link with mass moves.*give mass"):
        simulate(folding, START, 1.0, assembly_mode=1, engine=engine)


def test_a_load_with_a_value_but_no_series_is_left_to_numpy():
    """exp(3000) is infinite, and 1 over it zero."""
    made = one_link(torque("3/(1 + exp((0.3 - t)/0.0001))"))
    found = simulate(made, Start(0.0, 1.0), 1.0)
    assert abs(found.at([1.0]).dq[0] - 1.0 - 3.0 * 0.7 / INERTIA) < 1e-8
    if available():
        with pytest.raises(EngineError, match="no series"):
            simulate(made, Start(0.0, 1.0), 1.0, engine="compiled")
