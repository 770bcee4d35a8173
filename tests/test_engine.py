"""The compiled engine against NumPy, closed forms and SciPy's integrators."""

import sys
from dataclasses import replace

import numpy as np
import pytest
from closed_forms import (
    FOUR_BAR_ARCS,
    four_bar_angles,
    four_bar_coefficients,
    four_bar_frames,
    four_bar_poles,
)
from scipy.integrate import solve_ivp

from spherekit.engine.compiler import available, heyoka
from spherekit.engine.dynamics import dynamics
from spherekit.engine.kernels import kernel
from spherekit.engine.loads import AppliedLoad, convert, declared_loads, pair_torque
from spherekit.engine.simulation import simulate
from spherekit.errors import EngineError, EngineMissing, ModelError
from spherekit.files.read import load
from spherekit.model.expression import load_names, parse
from spherekit.model.mechanism import Mass
from spherekit.motion.motion import Tracer
from spherekit.planning.poles import all_poles
from spherekit.rates.field import evaluate
from spherekit.rates.request import request

compiled = pytest.mark.skipif(
    not available(), reason="heyoka is not installed; the engine is an extra"
)

MECHANISMS = (
    "four_bar",
    "stephenson",
    "double_butterfly",
    "roller_cam",
    "flat_cam",
    "bevel_pair",
    "planetary_bevel",
)


def test_without_heyoka_the_error_says_what_to_do(monkeypatch):
    monkeypatch.setitem(sys.modules, "heyoka", None)
    with pytest.raises(EngineMissing, match=r"spherekit\[compiled\].*NumPy"):
        heyoka()


def with_masses(mechanism):
    """Return a mechanism whose links have arbitrary physical tensors."""
    random = np.random.default_rng(3)
    masses = []
    for link in mechanism.links[1:]:
        points = random.normal(size=(5, 3))
        square = np.einsum("ni,nj->ij", points, points)
        tensor = np.trace(square) * np.eye(3) - square
        masses.append(Mass(link, tuple(map(tuple, tensor.tolist()))))
    return replace(mechanism, masses=tuple(masses), loads=())


def reference(mechanism, motion):
    """Return the poles of a motion and B, dB/dq, all by the NumPy route."""
    every = all_poles(len(mechanism.links))
    field = evaluate(motion, request(mechanism, mechanism.inputs[0].pair, every, every))
    inertia, change = np.zeros(len(motion)), np.zeros(len(motion))
    for mass in mechanism.masses:
        link = mechanism.link_number[mass.link]
        turn = motion.rotations[:, link]
        tensor = turn @ np.array(mass.tensor) @ np.swapaxes(turn, 1, 2)
        moment = np.einsum("nij,nj->ni", tensor, field.w[link])
        inertia += np.sum(field.w[link] * moment, axis=1)
        change += 2.0 * np.sum(field.dw[link] * moment, axis=1)
    return field, inertia, change


def agree(values, field, inertia, change, tolerance):
    for pole, unit in field.direction.items():
        rate, rate_dq = field.rate[pole], field.rate_dq[pole]
        known = np.abs(rate) > 1e-6
        vector = values.direction[pole] * values.rate[pole][:, None]
        gap = np.max(np.abs(vector - unit * rate[:, None]), axis=1)
        # The plan's own bound: long chains of intersections multiply rounding.
        allowed = tolerance + 40.0 * np.nan_to_num(field.error[pole])
        assert np.all((gap < allowed * (1.0 + np.abs(rate)))[known]), pole
        side = np.sign(values.rate[pole] * rate)
        gap = np.abs(values.rate_dq[pole] * side - rate_dq)
        scale = 1.0 + np.abs(rate) + np.abs(rate_dq)
        assert np.all((gap < allowed * scale)[known]), pole
    assert np.max(np.abs(values.inertia - inertia) / inertia) < tolerance
    assert np.max(np.abs(values.inertia_dq - change) / inertia) < 40 * tolerance


@compiled
@pytest.mark.parametrize("name", MECHANISMS)
def test_kernels_equal_the_numpy_route(name):
    made = with_masses(load(name))
    tracer = Tracer(made, search=False)
    motion = tracer.at(np.linspace(tracer.range[0] + 0.1, tracer.range[1] - 0.2, 24))
    assert not np.any(motion.failed)
    found = kernel(made, made.inputs[0].pair, with_inertia=True)
    agree(found.values(motion.values.T), *reference(made, motion), 2e-14)


@compiled
@pytest.mark.parametrize("name", ["four_bar", "stephenson", "watt", "eight_bar_01"])
def test_closed_form_positions_equal_the_numpy_route(name):
    made = with_masses(load(name))
    tracer = Tracer(made)
    q = np.linspace(tracer.range[0] + 0.1, tracer.range[1] - 0.2, 24)
    found = kernel(made, made.inputs[0].pair, source="input", with_inertia=True)
    for branch in tracer.branches:
        motion = Tracer(made, branch=branch.number).at(q)
        signs = [np.full(len(q), float(sign)) for sign in branch.signs]
        agree(found.values(np.vstack([q, *signs])), *reference(made, motion), 2e-14)


@compiled
def test_rates_by_arc_length_are_those_by_the_input_times_its_rate():
    made = with_masses(load("stephenson"))
    pair = made.inputs[0].pair
    tracer = Tracer(made, search=False)
    rows = tracer.at(np.linspace(0.1, 6.0, 24)).values.T
    by_input = kernel(made, pair, with_inertia=True, with_tangent=True).values(rows)
    found = kernel(
        made, pair, coordinate="arc", with_inertia=True, with_tangent=True
    ).values(rows)
    length = np.linalg.norm(by_input.tangent, axis=1)
    assert np.max(np.abs(np.linalg.norm(found.tangent, axis=1) - 1.0)) < 1e-15
    sense = np.sign(found.tangent[:, made.variable_names.index(f"theta_{pair}")])
    gap = found.tangent * (sense * length)[:, None] - by_input.tangent
    assert np.max(np.abs(gap)) < 1e-14
    assert np.max(np.abs(found.inertia * length**2 / by_input.inertia - 1.0)) < 1e-14
    # d(B / |dv/dq|^2)/ds, with d|dv/dq|^2/dq from the derivatives of the pairs' rates.
    own = [(pole, rate) for pole, rate in by_input.rate.items() if pole in ends_of(made)]
    slope = sum(rate * by_input.rate_dq[pole] for pole, rate in own) / length**2
    expected = by_input.inertia_dq - 2.0 * by_input.inertia * slope
    assert np.max(np.abs(found.inertia_dq * sense * length**3 - expected)) < 1e-11


def ends_of(mechanism):
    return {tuple(sorted(ends)) for ends in mechanism.ends}


@compiled
def test_rates_by_arc_length_are_finite_at_a_dead_centre():
    made = rocker()
    at = dead_centre(made)[:, None]
    found = kernel(made, "21", coordinate="arc", with_inertia=True).values(at)
    assert abs(found.rate[0, 1][0]) < 1e-13
    assert np.isfinite(found.inertia_dq[0])
    assert found.inertia[0] > 0.0


@compiled
def test_positions_beyond_reach_are_nan():
    made = rocker()
    found = kernel(made, "21", source="input", derivatives=False)
    rows = found(np.array([[0.0, 2.0], [1.0, 1.0]]))
    assert np.all(np.isnan(rows[found.columns.index("rate_1_4"), 0]))
    assert np.all(np.isfinite(rows[:, 1]))


class PaperModel:
    """B, dB/dq, theta_41 and its coefficient over q from the paper's formulas.

    Trigonometric interpolants of 256 samples, which are exact to rounding.
    """

    def __init__(self, mode):
        q = 2.0 * np.pi * np.arange(256) / 256
        frames = four_bar_frames(q, FOUR_BAR_ARCS, mode)
        poles = four_bar_poles(q, FOUR_BAR_ARCS, mode)
        w31, w41 = four_bar_coefficients(q, FOUR_BAR_ARCS, mode)
        w = {
            2: frames[2][:, :, 2],
            3: poles["31"] * w31[:, None],
            4: frames[1][:, :, 2] * w41[:, None],
        }
        inertia = np.zeros(len(q))
        for mass in load("four_bar").masses:
            own = np.einsum("nji,nj->ni", frames[int(mass.link)], w[int(mass.link)])
            inertia += np.einsum("ni,ij,nj->n", own, np.array(mass.tensor), own)
        self.mode = mode
        self.order = np.arange(129)
        self.inertia, self.rocker = np.fft.rfft(inertia) / 256, np.fft.rfft(w41) / 256

    def at(self, q):
        """Return B, dB/dq, theta_41, dtheta_41/dq at one q."""
        wave = 2.0 * np.exp(1j * self.order * q)
        wave[0] = 1.0
        angle = four_bar_angles(np.array([q]), FOUR_BAR_ARCS, self.mode)[0]
        return (
            np.sum(self.inertia * wave).real,
            np.sum(1j * self.order * self.inertia * wave).real,
            angle,
            np.sum(self.rocker * wave).real,
        )

    def solve(self, torque, q, rate, times):
        """Return q(t) for generalised forces torque(t, q, dq, theta_41, dtheta_41, w)."""

        def change(t, state):
            q, dq = state
            inertia, slope, angle, w = self.at(q)
            force = torque(t, q, dq, angle, w * dq, w)
            return [dq, (force - 0.5 * slope * dq * dq) / inertia]

        found = solve_ivp(
            change,
            (times[0], times[-1]),
            [q, rate],
            "DOP853",
            times,
            rtol=1e-13,
            atol=1e-13,
        )
        return found.y[0]


def start_of(mechanism, q, branch=0):
    """Return a configuration (variables,) at an input."""
    return Tracer(mechanism).at(np.array([q])).values[branch]


def paper_mode(mechanism, start):
    """Return the paper's mode number p of a configuration of the four-bar."""
    angle = start[mechanism.variable_names.index("theta_41")]
    both = [four_bar_angles(np.array([0.3]), FOUR_BAR_ARCS, p)[0] for p in (0, 1)]
    return int(np.argmin(np.abs(np.sin(0.5 * (np.array(both) - angle)))))


@compiled
@pytest.mark.parametrize("branch", [0, 1])
def test_forward_dynamics_of_the_paper_against_a_runge_kutta_code(branch):
    made = load("four_bar")
    start = start_of(made, 0.3, branch)
    times = np.linspace(0.0, 10.0, 41)
    drive = pair_torque(made, "drive", "21", "10*sin(2*t)")
    found = simulate(
        made, "21", start, times, rate=1.0, loads=[*declared_loads(made), drive]
    )

    def torque(t, q, dq, angle, turning, w):
        on_rocker = -5.0 * np.sin(angle) - 2.0 * turning
        return 10.0 * np.sin(2.0 * t) - np.sin(q) - 2.0 * dq + w * on_rocker

    model = PaperModel(paper_mode(made, start))
    expected = model.solve(torque, 0.3, 1.0, times)
    assert np.max(np.abs(found.q - expected)) < 5e-12
    assert found.ended == ""
    assert np.max(found.closure) < 1e-13
    assert np.max(np.abs(found.imbalance)) < 1e-12
    inertia, slope = np.transpose([model.at(q)[:2] for q in found.q])
    assert np.max(np.abs(found.inertia - inertia)) < 1e-13
    assert np.max(np.abs(found.inertia_dq - slope)) < 1e-11
    total = sum(found.forces.values())
    balance = found.inertia * found.ddq + 0.5 * found.inertia_dq * found.dq**2 - total
    assert np.max(np.abs(balance)) < 1e-11


@compiled
def test_loads_that_are_not_smooth_restart_the_integration():
    made = load("four_bar")
    start = start_of(made, 0.3)
    times = np.linspace(0.0, 6.0, 13)
    text = (
        "4*max(0, sin(3*t), 0.2) - 2*abs(theta_41) - sign(sin(theta_21))"
        " - min(dtheta_21, 1)"
    )
    found = simulate(
        made, "21", start, times, rate=1.0, loads=[pair_torque(made, "all", "21", text)]
    )

    def torque(t, q, dq, angle, turning, w):
        drive = 4.0 * max(0.0, np.sin(3.0 * t), 0.2) - 2.0 * abs(angle)
        return drive - np.sign(np.sin(q)) - min(dq, 1.0)

    expected = PaperModel(paper_mode(made, start)).solve(torque, 0.3, 1.0, times)
    assert np.max(np.abs(found.q - expected)) < 1e-9
    assert any(each.name.startswith("switch") for each in found.events)


@compiled
def test_friction_that_sticks_ends_the_motion_where_it_rests():
    made = load("four_bar")
    friction = pair_torque(made, "friction", "21", "-3*sign(dtheta_21)")
    start, times = start_of(made, 0.3), np.linspace(0.0, 50.0, 51)
    found = simulate(made, "21", start, times, rate=0.5, loads=[friction])
    assert len(found.t) < 51
    assert found.ended.startswith("switch 1 of the loads would turn back at once")
    turned = found.end_values[made.variable_names.index("theta_21")] - 0.3
    assert abs(3.0 * turned - found.kinetic[0]) < 1e-12
    kicked = simulate(
        made,
        "21",
        start,
        times[:2],
        rate=0.0,
        loads=[friction, pair_torque(made, "drive", "21", "-4")],
    )
    pulled = simulate(
        made, "21", start, times[:2], rate=0.0, loads=[pair_torque(made, "one", "21", "-1")]
    )
    assert np.max(np.abs(kicked.q - pulled.q)) < 1e-13


@compiled
@pytest.mark.parametrize("torque", ["", "-5*sin(theta_41)"])
def test_energy_of_a_conservative_system_over_1000_turns(torque):
    made = replace(load("four_bar"), loads=())
    loads = [pair_torque(made, "weight", "41", torque)] if torque else []
    rate = 4.0 if torque else 1.0
    last = 2.0 * np.pi * (220.0 if torque else 800.0)
    found = simulate(
        made,
        "21",
        start_of(made, 0.3),
        np.linspace(0.0, last, 101),
        rate=rate,
        loads=loads,
        tolerance=1e-15,
    )
    assert found.q[-1] - found.q[0] > 2.0 * np.pi * 1000
    angle = found.reduced[:, made.variable_names.index("theta_41")]
    energy = found.kinetic - (5.0 * np.cos(angle) if torque else 0.0)
    assert np.max(np.abs(energy - energy[0])) / found.kinetic.max() < 1e-12
    assert np.max(found.closure) < 1e-11


def rocker():
    """Return a four-bar none of whose grounded links turns fully."""
    made = load("four_bar")
    arcs = {"1": 60.0, "2": 55.0, "3": 70.0, "4": 40.0}
    sizes = {
        link: replace(given, arcs=(np.deg2rad(arcs[link]),))
        for link, given in made.geometry.links.items()
    }
    return replace(made, geometry=replace(made.geometry, links=sizes), loads=())


@compiled
def test_a_rocker_swings_over_its_dead_centre_1000_times():
    made = rocker()
    found = simulate(
        made,
        "21",
        start_of(made, 2.0),
        np.linspace(0.0, 1000.0, 201),
        arc_rate=6.0,
        loads=[pair_torque(made, "weight", "41", "-5*sin(theta_41)")],
        dead_centres=["theta_21"],
        tolerance=1e-15,
    )
    assert len(found.events) > 1000
    senses = np.array([each.sense for each in found.events])
    assert np.all(senses[1:] == -senses[:-1])
    angle = found.reduced[:, made.variable_names.index("theta_41")]
    energy = found.kinetic - 5.0 * np.cos(angle)
    assert np.max(np.abs(energy - energy[0])) / found.kinetic.max() < 1e-12
    # At a dead centre links 3 and 4 are one arc of 70 - 40 or 70 + 40 degrees.
    c, s = np.cos(np.deg2rad([60.0, 55.0])), np.sin(np.deg2rad([60.0, 55.0]))
    limits = (np.cos(np.deg2rad([30.0, 110.0])) - c[0] * c[1]) / (s[0] * s[1])
    low, high = np.sort(np.arccos(limits))
    assert low - 1e-12 < np.min(found.q)
    assert np.max(found.q) < high + 1e-12


@compiled
def test_whole_turns_count_for_a_torsion_spring():
    made = replace(load("four_bar"), loads=())
    spring = pair_torque(made, "spring", "21", "-0.05*theta_21")
    found = simulate(
        made,
        "21",
        start_of(made, 0.3),
        np.linspace(0.0, 60.0, 301),
        rate=4.0,
        loads=[spring],
    )
    assert np.max(found.turns) > 1.0
    assert np.min(found.q) < 0.0
    energy = found.kinetic + 0.025 * found.q**2
    assert np.max(np.abs(energy - energy[0])) < 1e-11 * energy[0]
    assert np.max(np.abs(found.imbalance)) < 1e-11 * energy[0]


@compiled
def test_a_stop_ends_the_motion_where_it_is():
    made = replace(load("four_bar"), loads=())
    found = simulate(
        made,
        "21",
        start_of(made, 0.3),
        np.linspace(0.0, 60.0, 61),
        rate=1.0,
        stops={"theta_21": 9.0},
    )
    place = made.variable_names.index("theta_21")
    assert abs(found.end_values[place] - 9.0) < 1e-13
    assert found.ended.startswith("stop of theta_21")
    assert 1 < len(found.t) < 61
    assert found.t[-1] <= found.end_time


@compiled
@pytest.mark.parametrize("name", ["stephenson", "roller_cam"])
def test_motion_conserves_energy_and_closure(name):
    made = with_masses(load(name))
    pair = made.inputs[0].pair
    found = simulate(made, pair, start_of(made, 0.5), np.linspace(0.0, 8.0, 9), rate=1.0)
    assert np.max(np.abs(found.imbalance)) < 1e-13 * found.kinetic[0]
    assert np.max(found.closure) < 1e-13
    gap = found.kinetic - 0.5 * found.inertia * found.dq**2
    assert np.max(np.abs(gap)) < 1e-13 * found.kinetic[0]


@compiled
def test_a_gear_pair_under_a_constant_torque():
    made = with_masses(load("bevel_pair"))
    torque = pair_torque(made, "motor", "02", "3")
    found = simulate(
        made, "01", start_of(made, 0.0), np.linspace(0.0, 5.0, 6), rate=0.0, loads=[torque]
    )
    # Both links turn about fixed axes, wheel 2 at half the speed in the other sense.
    own = {mass.link: np.array(mass.tensor) for mass in made.masses}
    inertia = own["1"][2, 2] + 0.25 * own["2"][2, 2]
    expected = -0.5 * 3.0 / inertia * 0.5 * found.t**2
    assert np.max(np.abs(found.q - expected)) < 1e-12
    assert found.made is dynamics(made, "01", [torque])


@compiled
def test_other_loads_are_expressions_of_the_motion():
    made = replace(load("four_bar"), loads=())
    text = pair_torque(made, "text", "41", "-5*sin(theta_41)")

    def force(moving):
        # A moment of the same size along the axis of pair 41, on link 4.
        axis = moving.flow.vectors[moving.variable("41")]
        moment = convertible("-5*sin(theta_41)", made, moving)
        return sum(moment * axis[k] * moving.flow.w[3][k] for k in range(3))

    given = AppliedLoad("moment", force, "moment of -5 sin(theta_41) on 4")
    times = np.linspace(0.0, 3.0, 7)
    one, other = (
        simulate(made, "21", start_of(made, 0.3), times, rate=1.0, loads=[each])
        for each in (text, given)
    )
    assert np.max(np.abs(one.q - other.q)) < 1e-13


def convertible(text, mechanism, moving):
    return convert(parse(text, load_names(mechanism.pair_number)).root, moving)


@compiled
def test_quadruple_precision_where_the_machine_has_it():
    if not hasattr(heyoka(), "real128"):
        pytest.skip("heyoka has no real128 here")
    made = load("four_bar")
    one = kernel(made, "21", [(0, 3)])
    exact = kernel(made, "21", [(0, 3)], number=heyoka().real128)
    values = Tracer(made).at(np.linspace(0.0, 6.0, 9)).values.T
    gap = exact(values.astype(heyoka().real128)).astype(float) - one(values)
    assert np.max(np.abs(gap)) < 1e-15


@compiled
def test_what_was_compiled_is_kept():
    made = load("four_bar")
    assert kernel(made, "21") is kernel(load("four_bar"), "21")
    assert kernel(made, "21") is not kernel(made, "41")
    assert kernel(made, "21").compiled.seconds > 0.0


@compiled
def test_bad_input_is_refused_before_any_integration():
    made = load("four_bar")
    start, times = start_of(made, 0.3), np.linspace(0.0, 1.0, 3)
    with pytest.raises(EngineError, match=r"pairs.contact.*fourier.*NumPy"):
        shaped = load("shaped_cam")
        kernel(shaped, shaped.inputs[0].pair)
    with pytest.raises(EngineError, match="no closed form"):
        kernel(load("double_butterfly"), "A", source="input")
    with pytest.raises(EngineError, match="no link that moves has mass"):
        simulate(replace(made, masses=()), "21", start, times, rate=1.0)
    with pytest.raises(EngineError, match="have to be finite and to rise"):
        simulate(made, "21", start, [0.0, 2.0, 1.0], rate=1.0)
    with pytest.raises(EngineError, match="loops stay open by"):
        simulate(made, "21", start + [0.0, 0.1, 0.0, 0.0], times, rate=1.0)
    with pytest.raises(EngineError, match="one finite initial rate"):
        simulate(made, "21", start, times)
    with pytest.raises(EngineError, match='"theta_42"; did you mean|no variable'):
        simulate(made, "21", start, times, rate=1.0, stops={"theta_42": 1.0})
    with pytest.raises(EngineError, match="dead centre of the input"):
        at = dead_centre(rocker())
        simulate(rocker(), "21", at, times, rate=1.0)
    with pytest.raises(ModelError, match="column"):
        pair_torque(made, "bad", "21", "__import__('os')")
    cam = with_masses(load("roller_cam"))
    on_contact = pair_torque(cam, "bad", "cam_shaft", "theta_contact")
    with pytest.raises(EngineError, match="is a contact and has no angle"):
        simulate(cam, "cam_shaft", start_of(cam, 0.5), times, rate=1.0, loads=[on_contact])


def dead_centre(mechanism):
    """Return a configuration at which the input's rate is zero."""
    found = simulate(
        mechanism,
        "21",
        start_of(mechanism, 2.0),
        [0.0, 20.0],
        arc_rate=1.0,
        dead_centres=["theta_21"],
    )
    return simulate(
        mechanism,
        "21",
        start_of(mechanism, 2.0),
        [0.0, found.events[0].time],
        arc_rate=1.0,
        dead_centres=["theta_21"],
    ).values[-1]
