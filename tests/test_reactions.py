"""Reactions in the pairs, holding torques and stiffness, against equations of the links."""

import re
from dataclasses import dataclass, replace
from types import SimpleNamespace

import numpy as np
import pytest
from helpers.polynomial_motions import START_INPUTS, motion_by_polynomial_laws
from helpers.scene_listener import SceneListener
from oracles.newton_euler import newton_euler, newton_euler_arguments, with_masses_and_loads

import spherekit as sk
from spherekit.cli.main import main
from spherekit.dynamics.inverse_dynamics import holding_torques
from spherekit.dynamics.lift_off import end_at_lift_off
from spherekit.dynamics.output_stiffness import output_stiffness
from spherekit.dynamics.reactions import reactions
from spherekit.dynamics.simulation_end import SimulationEnd
from spherekit.positions.position_analysis import PositionAnalysis
from spherekit.status import Status


@pytest.mark.parametrize("name", START_INPUTS)
def test_newton_and_euler_give_the_same_torques_and_reactions(name):
    """Torques and moments in pairs solve the Newton-Euler equations of all links.

    The oracle `newton_euler` writes them by hand. The mechanism has random masses and
    loads, and its inputs are polynomials of the time. Reactions are not compared in two
    cases: where redundant constraints leave them open, as in the differential, and where
    teeth press wheels apart, which the oracle leaves out.
    """
    seed = sum(map(ord, name))
    # `joint` is the R pair that has a motor, a spring and other loads.
    mechanism, joint = with_masses_and_loads(name, np.random.default_rng(seed))
    starts = START_INPUTS[name]
    result = reactions(motion_by_polynomial_laws(mechanism, starts, [0.0, 0.2, 0.4]))
    torques = result.torques
    largest_moment = np.nanmax(np.abs(result.moments))
    # `unbalanced` is the residual of the equations of motion of all links (N m).
    assert np.max(result.unbalanced) < 1e-12 * largest_moment
    assert np.any(result.is_open) == (name == "bevel_differential")
    has_pressure_angle = any(pair.pressure_angle for pair in mechanism.pairs)
    for row in range(len(torques.t)):
        # The oracle returns driving torques, and with `full` the moments in all pairs.
        expected = newton_euler(*newton_euler_arguments(torques, row, joint))
        assert torques.torques[row] == pytest.approx(expected, rel=1e-10, abs=1e-10)
        if np.any(result.is_open) or has_pressure_angle:
            continue
        expected = newton_euler(*newton_euler_arguments(torques, row, joint), full=True)
        for k, pair in enumerate(mechanism.pairs):
            components = expected[pair.name]
            count = len(components)
            moment = result.moments[row, k]
            assert moment[:count] == pytest.approx(components, abs=1e-11 * largest_moment)
            # For a contact, which has no axis, the oracle lists only the components that a
            # contact transmits. The others must be 0.
            if not pair.kind.has_axis:
                assert np.all(moment[count:] == 0.0)


FOLLOWER_INERTIA = 0.01
"""About the follower's pivot, kg m^2."""


def pressed(torque):
    """Return a cam with a flat-faced follower, both with inertia, pressed by a torque.

    `torque` is an expression (N m) such as "0.5"; the torque acts at the follower's pivot.
    """
    mechanism = sk.load("flat_cam").with_inputs("cam_shaft")
    tensor = np.diag([0.02, 0.02, FOLLOWER_INERTIA])
    mechanism = mechanism.with_mass("follower", tensor).with_mass("cam", tensor)
    return mechanism.with_loads(sk.PairTorque("press", "follower_pivot", torque))


@pytest.mark.parametrize("torque", ["5", "-5"])
def test_the_sign_of_a_contact_force_says_whether_it_presses(torque):
    """A positive `push` presses the follower away from the cam, a negative one would pull.

    The force F on the follower at the contact point p, a unit vector, follows from its
    moment p x F. It presses if it points away from the centre of the cam's circle. A
    contact that would have to pull has the status LIFT_OFF. The torque that presses in one
    of the two assembly modes (ways to assemble the links), 0 and 1, pulls in the other.
    This is also so in a run of several blocks. `pressed` returns the mechanism.
    """
    mechanism = pressed(torque)
    # The only input starts at 0.5 rad; the rows are at two times (s). Row 0 is tested.
    motion = motion_by_polynomial_laws(mechanism, starts=(0.5,), t=[0.0, 0.1])
    result = reactions(motion)
    contact = mechanism.pair_number["contact"]
    frame = result.frames[0, contact]
    # The columns of the frame are tangent, normal and contact point.
    contact_point = frame[:, 2]
    force = np.cross(frame @ result.moments[0, contact], contact_point)
    cam = mechanism.pair("contact").profiles[0]
    cam_rotation = result.torques.motion.rotations[0, mechanism.link_number["cam"]]
    cam_centre = cam_rotation @ np.array(cam.centre)
    presses = force @ (cam_centre - contact_point) < 0.0
    assert presses == (result.push[0, contact] > 0.0)
    assert np.linalg.norm(force) == pytest.approx(abs(result.push[0, contact]))
    assert presses == (result.status[0, contact] == Status.OK)

    run = sk.run(mechanism, "reactions", samples=7, block=3)
    lifted = run.frame("reactions").query("status == 'LIFT_OFF'")
    # The first part of the test is about mode 0. If the contact presses there, it lifts off
    # in mode 1.
    mode_that_lifts_off = 1 if presses else 0
    assert set(lifted["assembly_mode"]) == {mode_that_lifts_off}
    findings = run.summary["analyses"][0]["findings"]
    assert findings["pairs"]["contact"]["rows_that_lift_off"] == 7


def test_the_stiffness_of_an_output_is_a_moment_over_the_turn_that_it_causes():
    """The stiffness of an output is the moment over the small turn that it causes.

    Drives yield: a small moment m turns each input by w . m / k, and loop closure then
    moves the output. w is the angular velocity (3,) of the output per unit rate of an
    input, k the stiffness (N m/rad) of its drive. The turn of the output, link 3, is the
    skew part of its rotation from the unloaded to the loaded configuration. About a
    principal axis the turn has the direction of the moment and the size moment / principal
    stiffness.
    """
    mechanism = sk.load("five_bar")
    inputs = np.array([[1.0, 1.2]])
    drive_stiffness = np.array([40.0, 90.0])

    def motion_at(path):
        """Return the configurations of assembly mode 0 at inputs (n, 2) in rad."""
        return PositionAnalysis(mechanism, assembly_mode=0, path=path).motion()

    motion = motion_at(inputs)
    torques = holding_torques(motion)
    result = output_stiffness(torques, "3", "1", drive_stiffness)
    # The first principal axis in the only configuration, and the stiffness about it.
    axis = result.axes[0, 0]
    stiffness = result.stiffness[0, 0]
    moment = 1e-6 * axis
    # (inputs,) small angles by which the drives yield.
    turns_of_inputs = result.w[0] @ moment / drive_stiffness
    turned_inputs = inputs + turns_of_inputs
    link_3 = 2
    rotation = motion.rotations[0, link_3]
    turned_rotation = motion_at(turned_inputs).rotations[0, link_3]
    relative = turned_rotation @ rotation.T
    turn = 0.5 * np.array(
        [
            relative[2, 1] - relative[1, 2],
            relative[0, 2] - relative[2, 0],
            relative[1, 0] - relative[0, 1],
        ]
    )
    assert turn == pytest.approx(moment / stiffness, rel=1e-4, abs=1e-13)


def test_an_output_on_a_crank_is_held_by_its_input_alone():
    made = sk.load("five_bar")
    crank = replace(made.outputs[0], name="crank", link="2", direction=None)
    made = replace(made, outputs=(*made.outputs, crank))
    rows = sk.run(made, "statics", samples=3).frame("statics", "outputs")
    rows = rows.query("output == 'crank' and status == 'OK'")
    assert np.allclose(rows[["advantage_21", "advantage_51"]], [1.0, np.inf]) and len(rows)


def test_redundant_constraints_are_named_and_left_open(capsys):
    """Some moments of a differential cannot be known: they are NaN, with a remark."""
    command = ["run", "bevel_differential", "-a", "reactions", "--samples", "3"]
    assert main(command) == 0
    output, error_text = capsys.readouterr()
    assert "Redundant constraints leave undetermined" in output
    assert "warning" not in output + error_text
    result = sk.run("bevel_differential", "reactions", samples=3)
    table = result.frame("reactions")
    assert table["moment_x"].isna().any()
    assert not table["moment_z"].isna().any()


def test_the_screen_names_the_row_with_the_largest_reaction_of_each_pair():
    """The printed table has the largest moment of each pair, and where it occurs.

    The moment is that across the axis of the pair. The reference is the table of the run:
    its largest value, at the input (deg) and in the assembly mode (way to assemble the
    links) that are printed.
    """
    result = sk.run("roller_cam", "reactions", samples=9)
    (analysis,) = result.summary["analyses"]
    (screen_table,) = analysis["screen_tables"]
    table = result.frame("reactions").astype({"pair": str})
    table = table.set_index(["pair", "sample", "assembly_mode"])
    moments = table["transverse_moment"]
    pairs = set()
    for pair, size, place in screen_table["rows"]:
        pairs.add(pair)
        largest = moments.loc[pair].max()
        assert float(size) == pytest.approx(largest, rel=1e-4)
        if place == "-":  # the pair has no moment across its axis
            assert largest == 0.0
            continue
        input_deg, mode = re.fullmatch(r"cam_shaft = (\S+) deg, mode (\d+)", place).groups()
        sample = round(float(input_deg) / 45.0)  # nine samples over a turn
        assert moments.loc[(pair, sample, int(mode))] == pytest.approx(largest)
    assert pairs == set(moments.index.get_level_values("pair"))


@pytest.mark.parametrize("name", ["four_bar", "planetary_bevel", "universal_joint"])
def test_blocks_report_the_same_row_with_the_largest_reaction(name):
    """A turn ends where it began, so maxima repeat; the first one is reported."""
    findings = [
        sk.run(name, "reactions", samples=9, block=block).summary["analyses"][0]["findings"]
        for block in (None, 2)
    ]
    assert findings[1] == findings[0]


def test_a_pair_may_be_named_like_an_entry_of_the_summary(tmp_path):
    """The entry ``at`` of a record has positions of maxima; ``at`` is also a valid name."""
    sk.dump(sk.load("four_bar"), tmp_path / "four_bar.toml")
    text = (tmp_path / "four_bar.toml").read_text(encoding="utf-8")
    text = text.replace("[pairs.32]", "[pairs.at]").replace('"32"', '"at"')
    (tmp_path / "renamed.toml").write_text(text, encoding="utf-8")
    records = []
    for file in ("four_bar.toml", "renamed.toml"):
        run = sk.run(tmp_path / file, "reactions", samples=9, block=3)
        records.append(run.summary["analyses"][0]["findings"]["pairs"])
    assert records[1]["at"] == records[0]["32"]


def test_bearings_on_both_sides_of_the_centre_have_a_curve_each():
    """The bearings of each pin of the universal joint are at -0.035 m and 0.035 m."""
    listener = SceneListener()
    sk.run("universal_joint", "reactions", samples=5, recorder=listener)
    for scene in listener.scenes:
        paths = [primitive.path for primitive in scene.primitives]
        assert len(set(paths)) == len(paths)


def test_the_remark_names_the_row_with_the_largest_holding_torque():
    result = sk.run("four_bar", "statics", samples=9)
    pattern = r"torque at 21: (\S+) N m at 21 = (\S+) deg, mode (\d+)"
    remarks = " ".join(result.summary["remarks"])
    ((size, input_deg, mode),) = re.findall(pattern, remarks)
    sample = round(float(input_deg) / 45.0)  # nine samples over a turn
    torques = result.frame("statics").set_index(["sample", "assembly_mode"])["tau"]
    named_torque = torques.loc[(int(sample), int(mode))]
    assert named_torque == pytest.approx(float(size), rel=1e-4)
    assert abs(float(size)) == pytest.approx(torques.abs().max(), rel=1e-4)


LOCKING_BEARING = sk.Bearings("rub", "14", (0.1,), radius=0.5, coefficient=0.9, speed=0.01)
"""A bearing of pair 14 so large and rough that it locks itself (radius in m)."""


def test_a_bearing_that_locks_has_a_status_of_failure():
    mechanism, _ = with_masses_and_loads("stephenson", np.random.default_rng(5))
    mechanism = mechanism.with_loads(LOCKING_BEARING)
    motion = motion_by_polynomial_laws(mechanism, starts=(0.4,), t=[0.1])
    assert reactions(motion).torques.status[0] != Status.OK


def test_friction_that_follows_from_reactions_is_refused_where_it_is_not_solved(tmp_path):
    """Compiled engine, reference simulation and stored models refuse small friction too."""
    mechanism, _ = with_masses_and_loads("stephenson", np.random.default_rng(5))
    rubbing = mechanism.with_loads(replace(LOCKING_BEARING, coefficient=0.01))
    start = sk.Start(0.4, 1.0)
    for call in (
        lambda: sk.simulate(rubbing, start, 1.0, engine="compiled"),
        lambda: sk.reference_simulation(rubbing, start, 1e-3),
        lambda: sk.export(rubbing, tmp_path / "stored.npz"),
    ):
        with pytest.raises(sk.SpherekitError, match="the reaction of pair 14"):
            call()


PRESSING_TORQUE = 0.5  # N m
FAST_START = sk.Start(0.5, 18.0)
"""So fast that the follower of the cam lifts off within a second."""


def one_sided_cam():
    """Return a cam and its pressed follower, with a contact that can push only."""
    mechanism = pressed(str(PRESSING_TORQUE))
    pairs = [replace(p, one_sided=p.name == "contact") for p in mechanism.pairs]
    return replace(mechanism, pairs=tuple(pairs))


@pytest.fixture(scope="module")
def lift_off_simulation():
    """Return the simulation of the one-sided cam until its contact lifts off."""
    return sk.simulate(one_sided_cam(), FAST_START, 1.0, tolerance=1e-11, engine="numpy")


@pytest.mark.slow
def test_a_file_keeps_that_a_contact_is_one_sided(tmp_path):
    sk.dump(one_sided_cam(), tmp_path / "cam.toml")
    assert sk.load(tmp_path / "cam.toml").pair("contact").one_sided


@pytest.mark.slow
def test_a_contact_lifts_off_where_the_torque_alone_accelerates_the_follower(
    lift_off_simulation,
):
    """A contact lifts off where the pressing torque alone accelerates the follower.

    At the end of the simulation, the follower's inertia times its acceleration is this
    torque. The acceleration is the second derivative of a polynomial through its last six
    angles, 1e-4 s apart.
    """
    simulation = lift_off_simulation
    assert simulation.end.kind == "lift_off"
    assert "contact lifts off" in simulation.end.message
    assert simulation.events[-1].kind == "lift_off"
    assert 0.0 < simulation.end.t < 1.0
    step = 1e-4
    t = simulation.end.t - step * np.arange(6)[::-1]
    pivot = one_sided_cam().angles["follower_pivot"]
    angles = simulation.at(t).values[:, pivot]
    series = np.polynomial.Polynomial.fit(t, angles, 5)
    acceleration = series.deriv(2)(simulation.end.t)
    assert FOLLOWER_INERTIA * acceleration == pytest.approx(PRESSING_TORQUE, rel=1e-4)


@pytest.mark.slow
def test_the_summary_of_a_run_states_when_a_contact_lifts_off(lift_off_simulation):
    """A run states the same time of lift-off as `sk.simulate` with a small tolerance.

    The fixture `lift_off_simulation` has that result. `cost` lists the stages of a run with
    their seconds. A simulation follows one motion from its start, so there is no stage in
    which assembly modes (ways to assemble the links) are searched.
    """
    run = sk.run(
        one_sided_cam(),
        "dynamics",
        start="q=0.5rad,dq=18rad/s",
        duration=30.0,
        samples=61,
        engine="numpy",
    )
    end = run.summary["simulation"]["end"]
    assert end["kind"] == "lift_off"
    assert end["t"] == pytest.approx(lift_off_simulation.end.t, rel=1e-6)
    seconds = run.summary["cost"]["seconds"]
    assert "simulation" in seconds
    assert "search" not in seconds


@dataclass(frozen=True)
class SimulationOfThreeContacts:
    """What `end_at_lift_off` needs of a simulation: one step of 1 s, three contacts.

    The pushes (N m) of the contacts "early" and "late" vanish after 0.52 s and 0.53 s. The
    push of the contact "open" is not determined.
    """

    mechanism = SimpleNamespace(
        name="made",
        pairs=[SimpleNamespace(name=x, one_sided=True) for x in ("late", "open", "early")],
    )
    path = SimpleNamespace(starts=np.array([0.0]), lengths=np.array([1.0]))
    end: SimulationEnd
    events: tuple = ()

    def moments(self, t):
        moments = np.zeros((len(t), 3, 3))
        moments[:, 0, 0] = 9.0 * (0.53 - t)
        moments[:, 1, 0] = np.nan
        moments[:, 2, 0] = 0.52 - t
        return SimpleNamespace(moments=moments)

    def at(self, t):
        return SimpleNamespace(inputs=np.array(t)[:, None])


def test_the_contact_that_lifts_off_first_ends_a_simulation():
    """It does so although another contact pulls more soon afterwards.

    Both lift off between two of the times at which pushes are computed. A contact whose
    push is not determined does not end the simulation.
    """
    simulation = end_at_lift_off(SimulationOfThreeContacts(SimulationEnd("time", 1.0, "")))
    assert simulation.end.t == pytest.approx(0.52, abs=1e-12)
    assert "contact early lifts off" in simulation.end.message
    assert [event.pair for event in simulation.events] == ["early"]


@pytest.mark.slow
def test_a_simulation_that_begins_where_a_contact_would_pull_is_refused(
    lift_off_simulation,
):
    """It begins 0.05 rad beyond the place where the contact lifts off, at the same rate."""
    state = lift_off_simulation.at([lift_off_simulation.end.t])
    beyond = sk.Start(float(state.q[0]) + 0.05, float(state.dq[0]))
    with pytest.raises(sk.SpherekitError, match="would have to pull at the start"):
        sk.simulate(one_sided_cam(), beyond, 1.0)
