"""Simulations in wide numbers against closed forms, and what a trade says of others."""

from dataclasses import replace
from functools import partial

import mpmath as mp
import numpy as np
import pytest
from helpers.engines import needs_heyoka
from mechanism_examples.named_mechanisms import one_link_mechanism
from oracles.exact_four_bar import arcs_of
from oracles.exact_four_bar import four_bar as four_bar_at

import spherekit as sk
from spherekit.dynamics.forward_dynamics import simulate
from spherekit.dynamics.reference_simulation import reference_simulation
from spherekit.errors import EngineError
from spherekit.files.study import Start
from spherekit.mechanism.load import TorqueTable
from spherekit.mechanism.load_kinds import Gravity, JointLimit, PairTorque, Spring
from spherekit.positions.position_analysis import PositionAnalysis
from spherekit.proof.balls import Digits
from spherekit.runs.evaluation_options import Setting
from spherekit.runs.registry import create_analysis
from spherekit.runs.trade import trade
from spherekit.symbolic.compiler import available
from spherekit.tolerances import EPS

INERTIA, WEIGHT = 0.75, 2.5
FIFTY = Digits(50)


@pytest.fixture(autouse=True)
def digits():
    with mp.workdps(50), FIFTY.within():
        yield


pendulum = partial(
    one_link_mechanism, np.diag([INERTIA, 0.5, 0.5]), mass=WEIGHT, centre=(0.0, 0.0, -0.25)
)


def off(found, expected):
    """Return the largest difference of wide numbers from those of mpmath."""
    return max(
        float(abs(mp.mpf(a) - b)) for a, b in zip(np.ravel(found), expected, strict=True)
    )


def test_a_pendulum_swings_by_elliptic_functions():
    t = np.linspace(0.0, 6.0, 13)
    made = pendulum(Gravity("weight", (0.0, 0.0, -9.75)))
    found = reference_simulation(made, Start(0.0, 3.5), 6.0)
    at = found.at(t)
    w = mp.sqrt(mp.mpf(WEIGHT) * 0.25 * 9.75 / INERTIA)
    m = (mp.mpf(3.5) / (2 * w)) ** 2
    sn, cn = ([mp.ellipfun(k, w * x, m=m) for x in t] for k in ("sn", "cn"))
    angles = [2 * mp.asin(mp.sqrt(m) * x) for x in sn]
    assert off(at[0][:, 0], angles) < 1e-18
    assert off(at[1][:, 0], [2 * w * mp.sqrt(m) * x for x in cn]) < 4e-18
    assert off(at[2][:, 0], [-w * w * mp.sin(x) for x in angles]) < 2e-17


@pytest.mark.slow
def test_kinks_stops_and_tables_by_closed_forms():
    t = np.linspace(0.0, 2.0, 9)
    # free to 0.5 rad, then pushed away from there
    made = pendulum(PairTorque("push", "12", "3*max(0, theta_12 - 0.5)"))
    found = reference_simulation(made, Start(0.0, 1.0), 2.0)
    (kink,) = found.switches
    assert off([kink], [mp.mpf(0.5)]) < 1e-18
    angles = [mp.mpf(x) if x < 0.5 else 0.5 + mp.sinh(2 * (mp.mpf(x) - 0.5)) / 2 for x in t]
    assert off(found.at(t)[0][:, 0], angles) < 1e-17
    # dry friction brings it to rest, where it sticks
    made = pendulum(PairTorque("brake", "12", "-0.6*sign(dtheta_12)"))
    found = reference_simulation(made, Start(0.0, 1.0), 2.0)
    brake = mp.mpf(0.6) / INERTIA
    assert found.kind == "sticking" and off([found.end], [1 / brake]) < 1e-18
    last = found.at(np.array([2.0]))
    assert off(last[0][:, 0], [1 / (2 * brake)]) < 1e-17
    # a stop
    made = pendulum(joint_limits=(JointLimit("12", -1.0, 0.7),))
    found = reference_simulation(made, Start(0.0, 0.9), 2.0)
    assert found.kind == "joint_limit"
    assert off([found.end], [mp.mpf(0.7) / mp.mpf(0.9)]) < 1e-18
    # a table that repeats: up to 1 N m in 0.1 s and down to 0 in 0.2 s
    saw = TorqueTable("saw", "12", (0.0, 0.1, 0.3), (0.0, 1.0, 0.0), True)
    found = reference_simulation(pendulum(saw), Start(0.0, 0.0), 2.0)
    up, period = mp.mpf(0.1), mp.mpf(0.3)

    def gained(x):
        whole = int(mp.floor(x / period))
        rest = x - whole * period
        first = min(rest, up) ** 2 / (2 * up)
        later = max(rest - up, 0)
        second = later - later**2 / (2 * (period - up))
        return (whole * period / 2 + first + second) / INERTIA

    assert off(found.at(t)[1][:, 0], [gained(mp.mpf(x)) for x in t]) < 1e-17


STIFF, REST = 0.5, 0.2
FOUR_BAR = replace(sk.load("four_bar"), loads=(Spring("coil", "21", STIFF, REST),))
START = Start(0.5, 3.0)


def four_bar_inertia(made, q):
    """Return the equivalent inertia of each link at an input."""
    tensors = {int(mass.link): mass.tensor for mass in made.masses}
    return four_bar_at(arcs_of(made), q, 1).inertia(tensors)


def potential(q):
    return mp.mpf(STIFF) * (q - mp.mpf(REST)) ** 2 / 2


@pytest.fixture(scope="module")
def four_bar():
    """Return times, inputs and their rates of the four-bar, in wide numbers."""
    with mp.workdps(50), FIFTY.within():
        t = np.linspace(0.0, 0.5, 4)
        found = reference_simulation(FOUR_BAR, START, 0.5).at(t)
        return t, *([mp.mpf(x) for x in column[:, 0]] for column in found[:2])


@pytest.mark.slow
def test_a_four_bar_moves_by_conservation_of_energy(four_bar):
    _, q, rates = four_bar
    energies = [
        mp.fsum(four_bar_inertia(FOUR_BAR, x)) * v**2 / 2 + potential(x)
        for x, v in zip(q, rates, strict=True)
    ]
    assert off([q[0], rates[0]], [START.q, START.dq]) < 1e-18
    assert off(energies, [energies[0]] * len(q)) < 1e-16
    # The rates are those of the inputs, by a five-point stencil.
    step = 2.0**-12
    at = reference_simulation(FOUR_BAR, START, 0.5).at(0.25 + step * np.arange(-2, 3))
    low, near, _, far, high = map(mp.mpf, at[0][:, 0])
    assert off([(low - 8 * near + 8 * far - high) / (12 * step)], [at[1][2, 0]]) < 1e-10


def true_tables(q, rates):
    """Return the columns of `eksergian` for the four-bar, in 50 digits."""
    parts = [four_bar_inertia(FOUR_BAR, x) for x in q]
    slopes = [
        [mp.diff(lambda y, k=k: four_bar_inertia(FOUR_BAR, y)[k], x) for k in range(3)]
        for x in q
    ]
    force = [-STIFF * (x - mp.mpf(REST)) for x in q]
    B, dB = ([mp.fsum(each) for each in rows] for rows in (parts, slopes))
    pushes = [
        (f - slope * v * v / 2) / b
        for f, slope, v, b in zip(force, dB, rates, B, strict=True)
    ]
    main = {"q": q, "dq": rates, "ddq": pushes, "B": B, "dB_dq": dB, "Q": force}
    return {
        "eksergian": main | {"tau": [mp.mpf(0)] * len(q)},
        "inertia": {
            "B": [x for each in parts for x in each],
            "dB_dq": [x for each in slopes for x in each],
        },
        "loads": {"Q": force, "power": [f * v for f, v in zip(force, rates, strict=True)]},
    }


def scaled(tables, true):
    """Return the largest error of a column, over the largest number of its kind."""
    worst = EPS
    for name, columns in true.items():
        for column, numbers in columns.items():
            given = np.asarray(tables[name][column], dtype=float)
            alike = columns["Q"] if column == "tau" else numbers
            scale = 1 if column == "q" else max(map(abs, alike))
            worst = max(worst, off(given, numbers) / float(scale))
    return worst


SETTINGS = [Setting(integrator="numpy", tolerance=x) for x in (1e-4, 1e-9, 1e-13)]
if available():
    SETTINGS += [Setting(integrator="compiled", tolerance=x) for x in (1e-12, 1e-15)]

traded = partial(trade, analysis="eksergian", rounds=1)


def tables_of(made, analysis, setting, t, start):
    """Return the tables of a simulation by a setting, as an ordinary run gives them."""
    from spherekit.runs.sampling import sample_simulation
    from spherekit.runs.simulation_measurement import compute_timed_tables

    done = simulate(
        made, start, float(t[-1]), tolerance=setting.tolerance, engine=setting.integrator
    )
    tracer = PositionAnalysis(made, None, 0, samples=2)
    course = sample_simulation(tracer, done, t, setting.tolerance)
    return compute_timed_tables(course, create_analysis(analysis), Setting())[0]


@pytest.mark.slow
def test_reported_errors_of_a_four_bar_are_within_a_factor_two(four_bar):
    t, q, rates = four_bar
    found = traded(FOUR_BAR, samples=len(t), start=START, duration=0.5, settings=SETTINGS)
    assert "20 digits" in found.reference and found.floor < 1e-15
    true = true_tables(q, rates)
    for each in found.settings:
        tables = tables_of(FOUR_BAR, "eksergian", each.setting, t, START)
        error = scaled(tables, true)
        assert 0.5 * error <= each.error <= 2.0 * error, (each.name, each.error, error)


def short_trade():
    """Return the trade of one tolerance of NumPy for a pendulum."""
    made, start = pendulum(Gravity("weight", (0.0, 0.0, -9.75))), Start(0.0, 3.5)
    return traded(made, samples=3, start=start, duration=0.05, settings=SETTINGS[:1])


def test_the_table_says_what_the_reference_was(monkeypatch):
    assert short_trade().reference == "a simulation in 20 digits"

    def none(*given, **more):
        raise EngineError("there is none")

    monkeypatch.setattr("spherekit.runs.simulation_measurement.refined", none)
    by_numpy = partial(simulate, engine="numpy")
    monkeypatch.setattr(
        "spherekit.runs.simulation_measurement.simulate",
        lambda *x, engine, **y: none() if engine == "compiled" else by_numpy(*x, **y),
    )
    found = short_trade()
    assert found.reference.startswith("simulation numpy tolerance 1e-13, known to")
    assert found.reference.endswith("from numpy tolerance 1e-12 (there is none)")
    assert EPS <= found.floor < 1e-10


@needs_heyoka
def test_ends_that_depend_on_a_tolerance_have_no_reference():
    made = pendulum(PairTorque("burst", "12", "1/(0.1 - t)"))
    with pytest.raises(EngineError, match="ended at 0.1 s .* shorter time"):
        reference_simulation(made, Start(0.0, 1.0), 0.2)


@needs_heyoka
def test_dry_friction_is_compared_until_it_sticks():
    brake = PairTorque("brake", "21", "-0.6*sign(dtheta_21)")
    made = replace(FOUR_BAR, loads=(brake,))
    settings = [Setting(integrator="compiled", tolerance=1e-14)]
    start = Start(0.3, 0.5)
    found = traded(made, samples=5, start=start, duration=6.0, settings=settings)
    assert "20 digits" in found.reference
    assert found.settings[0].error < 1e-12
