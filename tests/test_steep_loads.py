"""Loads that change at once, by both engines against closed forms and Newton and Euler."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from helpers.engines import ENGINES
from mechanism_examples.named_mechanisms import one_link_mechanism as linked
from oracles.newton_euler import check_simulated_motion, with_point_masses
from scipy.integrate import quad

from spherekit.cli.main import FAILED_SAMPLES, main
from spherekit.dynamics.forward_dynamics import simulate
from spherekit.dynamics.step_probes import find_first_errors
from spherekit.errors import EngineError, SolveError
from spherekit.files.mechanism_reader import load
from spherekit.files.mechanism_writer import dump
from spherekit.files.study import Start
from spherekit.mechanism.load_kinds import Friction, JointLimit, PairTorque
from spherekit.symbolic.compiler import available

START = Start(q=0.3, dq=1.0)
RUBBED = [
    ("four_bar", ("43", "21"), 0.5, 0.2),
    ("stephenson", ("35", "14"), 0.05, 0.2),
    ("roller_cam", ("cam_shaft", "follower_pivot"), 0.01, 0.2),
    ("four_bar", ("43", "21"), 0.5, 6.0),
]


@pytest.mark.parametrize("extremum", [15 / 32, 0.47])
def test_an_extremum_between_equal_values_is_probed(extremum):
    """The probes at 7/16 and 8/16 have the same argument if its maximum is between them.

    The step is wrong within 1e-6 of the maximum only, which no even probe meets.
    """

    def probe(_steps, places):
        errors = np.where(np.abs(places - extremum) < 1e-6, 2.0, 0.0)
        return errors, (1.0 - (places - extremum) ** 2)[:, None]

    assert find_first_errors(probe, 1) == pytest.approx([extremum], abs=1e-6)


@pytest.mark.slow
@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize(("name", "rubbing", "smoothing_speed", "dry"), RUBBED)
def test_motion_with_dry_friction_satisfies_newton_and_euler(
    name, rubbing, smoothing_speed, dry, engine
):
    """Newton-Euler equations of all links hold along a driven motion with friction.

    Friction of `dry` N m acts at the pairs `rubbing`. It is smoothed: at zero speed it is
    zero, and at a few times `smoothing_speed` (deg/s) it has its full size. The driving
    torque is 10 sin(2 t) N m minus 2 N m s/rad times the rate of the input. The motion
    starts at 0.3 rad with 1 rad/s. Friction of 6 N m, in the last case, stops the crank at
    times and lets go again. The other cases are below 1 N m. A simulation that misses its
    tolerance says so by `missed`. `check_simulated_motion` is the independent reference,
    with an allowed deviation of 1e-7 (`within`).
    """
    if name == "four_bar":
        mechanism = replace(load(name), loads=())
    else:
        mechanism = with_point_masses(name)
    input_pair = mechanism.inputs[0].pair if mechanism.inputs else "21"
    mechanism = mechanism.with_inputs(input_pair)
    speed = np.deg2rad(smoothing_speed)
    drive = PairTorque("drive", input_pair, f"10*sin(2*t) - 2*dtheta_{input_pair}")
    frictions = [
        Friction(f"rub_{pair}", pair, torque=dry, viscous=0.0, speed=speed)
        for pair in rubbing
    ]
    mechanism = replace(mechanism, loads=(drive, *frictions))
    simulation = simulate(mechanism, START, 2.0, engine=engine, check=True)
    assert simulation.end.kind == "time"
    assert simulation.missed is None

    def driving_torque(t, rates):
        return [10.0 * np.sin(2.0 * t) - 2.0 * rates[0]]

    check_simulated_motion(
        simulation,
        driving_torque,
        speed=speed,
        within=1e-7,
        dry=dict.fromkeys(rubbing, dry),
    )
    is_held_at_times = dry > 1.0
    if is_held_at_times:
        speeds = np.abs(simulation.at(np.linspace(0.0, 2.0, 201)).dq)
        assert np.min(speeds) < 1e-3 < np.max(speeds)


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
"""Torques around t = 1.37 s, and their integrals over all times in units of high w."""


@pytest.mark.many
@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize("width", [pytest.param(WIDE, marks=pytest.mark.slow), NARROW])
@pytest.mark.parametrize("kind", IMPULSES)
def test_an_impulse_however_short_changes_the_momentum(kind, width, engine):
    """A short impulse of torque changes the angular momentum of a link by its integral.

    The torque acts around 1.37 s, for about `width` seconds. Its integral over all times is
    0.1 N m s times the area in `IMPULSES`. All torques vanish quickly before and after this
    time, except that of "root", (1 + x^2)^(-3/2) with x = (t - 1.37) / width. Its integral
    from x to infinity is 1 - x / sqrt(1 + x^2), by which the parts before 0 s and after 2 s
    are subtracted.

    The torque "box" jumps. The NumPy engine may end there, because it has no step that is
    short enough, and then says so. `missed` is a message if the simulation misses its
    tolerance.
    """
    text, area = IMPULSES[kind]
    high = 0.1 / width
    load_torque = torque(text.format(high=repr(high), w=repr(width)))
    simulation = simulate(one_link(load_torque), Start(0.0, 1.0), 2.0, engine=engine)
    if engine == "numpy" and kind == "box" and simulation.end.kind == "too_fast":
        assert abs(simulation.end.t - 1.37) < 2.0 * width
        assert "jumps" in simulation.end.message
        return
    area_outside = 0.0
    if kind == "root":
        for duration in (1.37, 0.63):  # before and after the middle of the impulse
            ratio = duration / width
            area_outside += 1.0 - ratio / np.hypot(1.0, ratio)
    expected_rate = 1.0 + 0.1 * (area - area_outside) / INERTIA
    assert abs(simulation.at([2.0]).dq[0] - expected_rate) < 1e-8
    assert simulation.missed is None


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
    """The rate w of a link that friction stops is that of a closed form, to 1e-8 rad/s.

    From J w' = -F tanh(w / s), with the speed s over which friction is smoothed, follows
    sinh(w / s) = sinh(1 / s) exp(-F t / (J s)), with the initial rate 1 rad/s. Its
    logarithm is evaluated, since sinh overflows: ln sinh x = x + ln(1 - exp(-2 x)) - ln 2,
    and asinh(exp(y)) = y + ln 2 for large y. The simulation is repeated with a smaller
    tolerance (`check`), and both agree: it does not miss its tolerance.
    """
    friction_torque = 2.0
    mechanism = one_link(Friction("rub", "12", friction_torque, 0.0, speed))
    simulation = simulate(mechanism, Start(0.0, 1.0), 1.0, engine=engine, check=True)
    t = np.array([0.1, 0.3, 0.37, 0.375, 0.38, 0.5, 1.0])
    log_sinh_at_start = 1.0 / speed + np.log1p(-np.exp(-2.0 / speed)) - np.log(2.0)
    log_sinh = log_sinh_at_start - friction_torque * t / (INERTIA * speed)
    # At y = 20 the rest of asinh(exp(y)) is exp(-40) / 4, below the rounding error.
    asinh = np.where(
        log_sinh > 20.0,
        log_sinh + np.log(2.0),
        np.arcsinh(np.exp(np.minimum(log_sinh, 20.0))),
    )
    assert np.max(np.abs(simulation.at(t).dq - speed * asinh)) < 1e-8
    assert simulation.missed is None


@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize("text", ["min(1e17*(theta_12 + 9), 2)", "max(1, 2, 0*theta_12)"])
def test_an_extremum_that_is_always_the_same_argument_acts_like_it(text, engine):
    """The torque is 2 N m throughout, so the acceleration is 2 / INERTIA."""
    found = simulate(one_link(torque(text)), Start(0.0, 1.0), 0.5, engine=engine)
    assert found.at([0.5]).dq[0] == pytest.approx(1.0 + 1.0 / INERTIA, abs=1e-8)


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
    """A simulation whose errors grow beyond its tolerance says so, and `--strict` fails.

    A torque turns the equation of motion of a link into q'' = 16 q, with a saddle at q = 0.
    From q = 1 with the rate -4 the exact motion is exp(-4 t), which tends to the saddle.
    Any error grows like exp(4 t). For one second the tolerance is met, for seven it is not.
    """
    path = tmp_path / "saddle.toml"
    dump(one_link(torque(repr(16.0 * INERTIA) + "*theta_12")), path)

    def run_command(seconds, *flags):
        start = ["--start", "q=1rad,dq=-4rad/s", "--duration", seconds, "--engine", engine]
        status = main(["run", str(path), "-a", "eksergian", *start, *flags])
        output, error_text = capsys.readouterr()
        return status, output, error_text

    status, output, error_text = run_command("1", "--strict")
    assert status == 0
    assert "in the simulated input (tolerance 1e-09 rad)," in output
    assert "misses" not in error_text
    for flags, expected_status in (((), 0), (("--strict",), FAILED_SAMPLES)):
        status, output, error_text = run_command("7", *flags)
        assert status == expected_status
        assert "in the simulated input (tolerance 1e-09 rad, which was MISSED)," in output
        warning = "Warning: the simulation misses its tolerance of 1.0e-09 rad"
        assert warning in output


@pytest.mark.parametrize("engine", ENGINES)
def test_masses_and_loads_scaled_together_give_the_same_motion(engine):
    """A factor of 2^-40 cancels in the equation of motion; angles after 5 s agree."""
    final_angles = []
    for scale in (1.0, 2.0**-40):
        mechanism = one_link(torque(f"{scale!r}*10*sin(2*t) - {scale!r}*theta_12**3"))
        masses = []
        for mass in mechanism.masses:
            tensor = tuple(tuple(scale * x for x in row) for row in mass.tensor)
            masses.append(replace(mass, tensor=tensor))
        mechanism = replace(mechanism, masses=tuple(masses))
        simulation = simulate(mechanism, Start(0.3, 1.0), 5.0, engine=engine)
        final_angles.append(simulation.at([5.0]).q[0])
    assert abs(final_angles[0] - final_angles[1]) < 1e-9


@pytest.mark.parametrize("engine", ENGINES)
def test_a_simulation_ends_where_no_link_with_mass_moves(engine):
    """A simulation ends where the only link with mass stands still: there is no inertia.

    This is the rocker of a four-bar, which stands still where it turns back. There crank
    and coupler are one arc, of 70 - 20 or of 70 + 20 degrees. The rocker's angle follows
    from the spherical law of cosines with the base of 60 and the rocker of 40 degrees.
    """
    mechanism = load("four_bar")
    mass_of_rocker = tuple(mass for mass in mechanism.masses if mass.link == "4")
    light = replace(mechanism, masses=mass_of_rocker, loads=())
    simulation = simulate(light, START, 10.0, engine=engine)
    assert simulation.end.kind == "no_inertia"
    assert "equivalent inertia" in simulation.end.message

    rocker, base = np.radians([40.0, 60.0])
    one_arc = np.radians([50.0, 90.0])
    cosines = np.cos(one_arc) - np.cos(rocker) * np.cos(base)
    cosines /= np.sin(rocker) * np.sin(base)
    theta_41 = mechanism.variable_names.index("theta_41")
    angle = simulation.at([simulation.end.t]).values[0, theta_41]
    # The file counts the angle from another zero, which changes the sign of the cosine.
    misses = np.abs(abs(np.cos(angle)) - np.abs(cosines))
    assert np.min(misses) < 1e-4


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
        with pytest.raises(EngineError, match="no Taylor series"):
            simulate(made, Start(0.0, 1.0), 1.0, engine="compiled")


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("engine", ENGINES)
def test_an_infinite_argument_of_a_steep_function_prints_no_warning(engine):
    """The torque tanh(exp(700 t)) is 1 N m from 0.01 s on, and its exp infinite from 1.1 s.

    With u = exp(700 t), the impulse that it lacks before is the integral of
    (1 - tanh u) / (700 u) from u = 1 on.
    """
    mechanism = one_link(torque("tanh(exp(700*t))"))
    simulation = simulate(mechanism, Start(0.0, 1.0), 2.0, engine=engine)
    lacking, _ = quad(lambda u: (1.0 - np.tanh(u)) / (700.0 * u), 1.0, np.inf)
    expected_rate = 1.0 + (2.0 - lacking) / INERTIA
    assert abs(simulation.at([2.0]).dq[0] - expected_rate) < 1e-8
