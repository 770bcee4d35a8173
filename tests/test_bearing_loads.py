"""Forces through the centre and loads of bearings, against links held by these alone."""

from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from helpers.polynomial_motions import START_INPUTS, motion_by_polynomial_laws
from helpers.refusals import mechanism_text
from mechanism_examples.named_mechanisms import one_link_mechanism
from oracles.newton_euler import (
    bearing_forces,
    newton_euler_arguments,
    with_masses_and_loads,
)

import spherekit as sk
from spherekit.cli.main import main
from spherekit.dynamics.reactions import reactions

BEARING_POSITIONS_M = (0.4, 0.9)
PRESSURE_ANGLE_RAD = np.radians(20.0)
BEARING_MECHANISMS = (
    "two_dof_spm",
    "three_rrr",
    "stephenson",
    "shaped_flat_cam",
    "roller_cam",
    "bevel_differential",
)
STARTS = {name: START_INPUTS[name] for name in BEARING_MECHANISMS}
STARTS["bevel_differential"] = (0.3, 0.2)


def mechanism_on_bearings(name, seed=3, distance=0.7):
    """Return a shipped mechanism with masses, loads and two bearings in every R pair.

    Tests compute the forces of all bearings and contacts. Equilibrium has to determine
    these forces. If every bearing held its links along the axis, there would be more axial
    forces than equilibrium can determine. Therefore some pairs have two floating bearings,
    which let the links slide along the axis. In the other pairs the first bearing supports
    the whole axial force.

    Parameters
    ----------
    name, seed
        Shipped mechanism, and seed of its masses.
    distance
        Distance (m) between each contact and the centre of the sphere. The contacts are the
        pairs of wheels and of cams, which have no axis.

    Returns
    -------
    mechanism
        Mechanism with masses on all links, one load of every kind, and bearings.
    joint
        Name of the R pair (revolute joint) with motor, spring, damper and friction.
    """
    mechanism, joint = with_masses_and_loads(name, np.random.default_rng(seed))
    # A file without inputs has a default input. It is declared here like any other.
    mechanism = mechanism.with_inputs(*[item.pair for item in mechanism.inputs])
    pairs = []
    for pair in mechanism.pairs:
        if pair.type == "Cr":  # wheels with teeth that roll on each other
            pair = replace(pair, distance=distance, pressure_angle=PRESSURE_ANGLE_RAD)
        elif not pair.kind.has_axis:  # cams, which have no teeth
            pair = replace(pair, distance=distance, pressure_angle=None)
        pairs.append(pair)
    mechanism = replace(mechanism, pairs=tuple(pairs))

    # `lacking` says what the mechanism would have to state so that all forces are
    # determined. It already states all centres of mass and distances of contacts. The pairs
    # in `floating` need floating bearings. With these, all forces are determined.
    lacking = reactions(
        motion_by_polynomial_laws(mechanism, STARTS[name], [0.0, 0.2])
    ).lacking
    assert lacking.enough
    assert not lacking.centres
    assert not lacking.distances
    bearings = []
    for pair in mechanism.pairs:
        if pair.kind.has_axis:
            # Share of the axial force that each of the two bearings supports
            axial = (0.0, 0.0) if pair.name in lacking.floating else (1.0, 0.0)
            bearings.append(
                sk.Bearings(f"at_{pair.name}", pair.name, BEARING_POSITIONS_M, axial=axial)
            )
    return mechanism.with_loads(*mechanism.loads, *bearings), joint


@pytest.mark.slow
@pytest.mark.many
@pytest.mark.parametrize("name", STARTS)
def test_bearing_forces_are_those_of_free_bodies(name):
    """Forces on all bearings and contacts are those of Newton's and Euler's equations.

    In the reference `bearing_forces` every link is a free body that only its bearings and
    contacts support. Teeth touch with one of two flanks and can only push. Every
    combination of flanks is solved, and exactly one has pushing forces only.

    Forces are those of the first link of a pair on the second. The reference has them in
    ground axes, in a dictionary. An R pair has two bearings, 0 and 1, which share a load
    "at_PAIR". Their keys are ("at_PAIR", 0) and ("at_PAIR", 1). The key of a contact is
    (name of the pair, 0). A row is one of two instants.
    """
    # `joint` is the name of the R pair with motor, spring, damper and friction.
    mechanism, joint = mechanism_on_bearings(name)
    computed_reactions = reactions(
        motion_by_polynomial_laws(mechanism, STARTS[name], [0.0, 0.2])
    )
    # No force is undetermined. `wanted` lists what a user would have to add to the file of
    # the mechanism to determine all forces; here this is nothing.
    assert not np.any(computed_reactions.open_forces)
    missing_information = computed_reactions.lacking.wanted
    assert not missing_information
    torques = computed_reactions.torques
    meshes = [pair.name for pair in mechanism.pairs if pair.pressure_angle is not None]
    for row in range(len(torques.t)):
        arguments = newton_euler_arguments(torques, row, joint)
        frames = computed_reactions.frames[row]
        solutions = []
        for signs in product((1.0, -1.0), repeat=len(meshes)):
            flanks = dict(zip(meshes, signs, strict=True))
            # Also the number of undetermined forces, and the residual of the equations.
            forces, undetermined, residual = bearing_forces(*arguments, flanks)
            # The y axis of the frame of a mesh points to the first wheel. A push of this
            # wheel on the second one has a negative y component.
            y_components = [
                forces[mesh, 0] @ frames[mechanism.pair_number[mesh]][:, 1]
                for mesh in meshes
            ]
            if all(y_component < 0.0 for y_component in y_components):
                solutions.append((forces, undetermined, residual))
        ((forces, undetermined, residual),) = solutions
        largest_force = max(np.max(np.abs(force)) for force in forces.values())
        assert undetermined == 0
        assert residual < 1e-12 * largest_force

        for k, pair in enumerate(mechanism.pairs):
            # Reactions are given in the frame of the pair, the reference in ground axes.
            if pair.kind.has_axis:
                load = f"at_{pair.name}"
                in_ground = computed_reactions.on_bearings[load][row] @ frames[k].T
                reference = np.array([forces[load, n] for n in (0, 1)])
            else:
                in_ground = computed_reactions.forces[row, k] @ frames[k].T
                reference = forces[pair.name, 0]
            assert in_ground == pytest.approx(reference, abs=1e-11 * largest_force)


SHAFT = mechanism_text("shaft")


@pytest.mark.parametrize("speed", [0.0, 6.0])
def test_a_vertical_shaft_stands_on_its_fixed_bearing(speed, tmp_path):
    """Bearing forces of a shaft at rest and turning are those calculated by hand.

    The shaft has 10 kg. Its centre of mass is 0.1 m beside the axis, at the height 0.3 m.
    The bearings are at the heights 0.2 m (fixed, supports axial forces) and 0.7 m.

    - The fixed bearing supports the weight, 10 kg x 9.81 m/s^2 = 98.1 N.
    - The moment of the weight, 98.1 N x 0.1 m, is balanced by radial forces of 9.81 N m /
      0.5 m = 19.62 N: outwards at the lower bearing, inwards at the upper one.
    - At the angular velocity w, the shaft pulls outwards with 10 kg x 0.1 m x w^2 at 0.3 m.
      The bearing at 0.2 m supports 4/5 of this, and that at 0.7 m 1/5.
    """
    (tmp_path / "shaft.toml").write_text(SHAFT)
    shaft = sk.load(tmp_path / "shaft.toml")
    angle = 0.4
    motion = motion_by_polynomial_laws(
        shaft, starts=(angle,), t=[0.0], rate=speed, quadratic=0.0
    )
    computed_reactions = reactions(motion)
    # Forces on the shaft at the two bearings, at the only time. They are in the frame of
    # the pair: x and y are radial, z is axial. "bearings" is the name of the load.
    ((first, second),) = computed_reactions.on_bearings["bearings"]
    frame = computed_reactions.frames[0, 0]  # columns: axes of this frame in ground axes
    outwards = np.array([np.cos(angle), np.sin(angle), 0.0])  # x of the shaft
    radial = np.array([frame @ first, frame @ second]) @ outwards
    # 10 kg x 0.1 m x w^2
    pull = speed**2
    assert radial == pytest.approx([19.62 - 0.8 * pull, -19.62 - 0.2 * pull])
    assert [first[2], second[2]] == pytest.approx([98.1, 0.0], abs=1e-12)


def test_the_command_reports_axial_loads_and_bearings_that_hold_nothing(tmp_path, capsys):
    """A vertical shaft of 10 kg: a run prints and writes its axial load of 98.1 N.

    The load is the weight, 10 kg x 9.81 m/s^2. The file of the shaft has two bearings, of
    which the first is fixed. If both float (let the shaft slide along its axis), the run
    names the link "shaft", which no bearing supports axially.
    """
    path = tmp_path / "shaft.toml"
    path.write_text(SHAFT)
    command = ["run", str(path), "-a", "reactions", "--samples", "3"]
    assert main([*command, "--out", str(tmp_path / "out")]) == 0
    assert "Largest axial load of a bearing: 98.1 N" in capsys.readouterr().out
    rows = (tmp_path / "out" / "reactions_bearings.csv").read_text().splitlines()
    assert len(rows) == 1 + 3 * 2  # a heading, then two bearings at each of three samples
    assert "radial,axial,status" in rows[0]

    path.write_text(SHAFT.replace("axial = [1, 0]", "axial = [0, 0]"))
    assert main(command) == 0
    printed = capsys.readouterr()
    assert "All pairs of the links shaft let them slide" in printed.out + printed.err


def test_axial_shares_of_bearings_are_kept_in_files_and_checked(tmp_path):
    """`axial` has one number 0 or 1 for each of the two bearings."""
    path = tmp_path / "shaft.toml"
    path.write_text(SHAFT.replace("axial = [1, 0]", "axial = [0, 0]"))
    copy = tmp_path / "copy.toml"
    sk.dump(sk.load(path), copy)
    assert sk.load(copy).loads[1].axial == (0.0, 0.0)
    for wrong in ("[1]", "[0.5, 0.6]", "[2, -1]"):
        path.write_text(SHAFT.replace("[1, 0]", wrong))
        with pytest.raises(sk.SpherekitError, match="axial"):
            sk.load(path)


@pytest.mark.slow
def test_a_spinning_shaft_is_slowed_by_its_weight_on_the_fixed_bearing():
    """Friction of a fixed bearing slows a balanced vertical shaft as calculated by hand.

    A fixed bearing supports the axial force of the shaft, a floating one does not. Here the
    fixed bearing carries the whole weight m g. So C a = -c r m g, with the moment of
    inertia C = 0.2 kg m^2, the coefficient c = 0.4 and the radius r = 0.05 m. From the rate
    w = 9 rad/s on, the angle is w t - c r m g t^2 / (2 C).

    The argument `axial` says which bearing is fixed. Two other cases are tried:

    - `axial` is not stated. The friction then ignores the force on the shaft. It follows
      only from the moment that the bearings exert about the centre of the sphere. The
      moment of the weight is 0, because the centre of mass is on the vertical axis. So
      there is no friction.
    - Both bearings float. No bearing carries the weight, and the simulation is refused.
    """
    weight = sk.Gravity("weight", (0.0, 0.0, -10.0))
    bearings = sk.Bearings(
        "rub",
        "12",
        positions=(0.2, 0.7),
        radius=0.05,
        coefficient=0.4,
        speed=1e-3,  # rad/s below which the jump of Coulomb's law is smoothed
        axial=(1.0, 0.0),  # the first bearing is fixed, the second one floats
    )
    shaft = one_link_mechanism(
        np.diag([0.5, 0.5, 0.2]),
        weight,
        bearings,
        mass=4.0,
        centre=(0.0, 0.0, 0.3),
        axis=(0.0, 0.0, 1.0),
    )
    start = sk.Start(0.0, 9.0)
    # c r m g / C, with the weight m g = 4 kg x 10 m/s^2
    deceleration = 0.4 * 0.05 * 40.0 / 0.2
    history = sk.simulate(shaft, start, 1.0).at([0.5, 1.0])
    angles = [4.5 - deceleration / 8.0, 9.0 - deceleration / 2.0]
    assert history.q == pytest.approx(angles, abs=1e-9)

    without_axial = shaft.with_loads(weight, replace(bearings, axial=None))
    assert sk.simulate(without_axial, start, 1.0).at([1.0]).q[0] == pytest.approx(9.0)
    floating = shaft.with_loads(weight, replace(bearings, axial=(0.0, 0.0)))
    with pytest.raises(sk.SpherekitError, match="the force through the centre in pair"):
        sk.simulate(floating, start, 1.0)


def test_bearing_friction_equals_a_load_of_the_same_torque():
    """Friction of bearings acts like a load with the torque that its formula states.

    The torque is c r (sum of |forces on the bearings|) tanh(rate / speed), against the
    rate. The third pair of the mechanism has friction (c = 0.3, r = 0.02 m, speed 0.01
    rad/s). When its torque is added as a constant load instead, all reactions are the same;
    without friction the driving torque is another.
    """
    mechanism, _ = mechanism_on_bearings("stephenson")
    pair = mechanism.pairs[2].name
    bearings = next(
        load
        for load in mechanism.loads
        if isinstance(load, sk.Bearings) and load.pair == pair
    )
    rubbing = replace(bearings, radius=0.02, coefficient=0.3, speed=0.01)
    loads = [rubbing if load is bearings else load for load in mechanism.loads]
    # The input starts at 0.4 rad, and the motion is evaluated at the time 0.1 s only.
    input_at_start = (0.4,)
    times = [0.1]
    with_friction = reactions(
        motion_by_polynomial_laws(mechanism.with_loads(*loads), input_at_start, times)
    )

    torques = with_friction.torques
    # `rates` (rows, inputs, variables) are rates of variables per unit rate of each input.
    rate = torques.rates[0, :, mechanism.angles[pair]] @ torques.input_rates[0]
    on_bearings = with_friction.on_bearings[bearings.name][0]
    total_force = np.sum(np.linalg.norm(on_bearings, axis=1))
    friction_torque = -0.3 * 0.02 * total_force * np.tanh(rate / 0.01)

    as_load = sk.PairTorque("rub_", pair, repr(float(friction_torque)))
    with_load = mechanism.with_loads(*mechanism.loads, as_load)
    same = reactions(motion_by_polynomial_laws(with_load, input_at_start, times))
    assert same.forces == pytest.approx(with_friction.forces, rel=1e-11, abs=1e-11)
    assert same.torques.tau == pytest.approx(torques.tau, rel=1e-12)
    without_friction = reactions(
        motion_by_polynomial_laws(mechanism, input_at_start, times)
    )
    assert abs(without_friction.torques.tau[0] - torques.tau[0]) > 1e-3


def test_reactions_name_what_is_missing_to_determine_forces():
    """Without a centre of mass and without bearings, no bearing force is determined.

    The result and the summary of a run name the link without a centre of mass. They also
    name six pairs whose bearings have to float (let the links slide along the axis). This
    number follows by counting. The seven R pairs have 21 force components, but the five
    moving links of the mechanism have 15 equations of force, so six components would remain
    undetermined.
    """
    mechanism, _ = with_masses_and_loads("stephenson", np.random.default_rng(3))
    light = replace(mechanism.masses[2], mass=None, centre=None)
    masses = (*mechanism.masses[:2], light, *mechanism.masses[3:])
    # Gravity is left out, because it needs the mass of every link.
    loads = [load for load in mechanism.loads if not isinstance(load, sk.Gravity)]
    mechanism = replace(mechanism, masses=masses, loads=tuple(loads))
    computed_reactions = reactions(
        motion_by_polynomial_laws(mechanism, STARTS["stephenson"], [0.0])
    )
    assert computed_reactions.lacking.centres == (light.link,)
    assert len(computed_reactions.lacking.floating) == 6
    is_undetermined = computed_reactions.open_forces  # per component of each force
    assert np.all(is_undetermined)

    run = sk.run(mechanism, "reactions", samples=3)
    (analysis,) = run.summary["analyses"]
    need = analysis["findings"]["forces_need"]
    assert need["centres_of_mass"] == [light.link]
    assert len(need["floating_pairs"]) == 6


def test_gears_keep_their_pressure_angle_and_distance_in_files(tmp_path):
    made, _ = mechanism_on_bearings("bevel_differential")
    sk.dump(made, tmp_path / "gears.toml")
    again = sk.load(tmp_path / "gears.toml")
    assert [x.pressure_angle for x in again.pairs] == pytest.approx(
        [x.pressure_angle for x in made.pairs]
    )
    assert [x.distance for x in again.pairs] == [x.distance for x in made.pairs]
    with pytest.raises(sk.SpherekitError, match="pressure_angle: found 2 rad"):
        pairs = [replace(x, pressure_angle=2.0) if x.distance else x for x in made.pairs]
        replace(made, pairs=tuple(pairs))


def test_rows_that_are_out_of_reach_have_no_bearing_forces():
    """A floating bearing bears no axial force, but in a failed row no force is known.

    The rocker of the four-bar reaches one of five samples of a turn.
    """
    bearings = sk.Bearings("floating", "32", BEARING_POSITIONS_M, axial=(0.0, 0.0))
    mechanism = sk.load("four_bar").with_inputs("41")
    mechanism = mechanism.with_loads(*mechanism.loads, bearings)
    run = sk.run(mechanism, "reactions", samples=5)
    table = run.frame("reactions", "bearings")
    is_ok = table["status"] == "OK"
    assert set(is_ok) == {True, False}
    assert np.all(table["axial"][is_ok] == 0.0)
    assert np.all(np.isnan(table["axial"][~is_ok]))
    findings = run.summary["analyses"][0]["findings"]
    for bearing in findings["bearings"].values():
        sample, _mode, _place = bearing["at"]["largest_axial_N"]
        assert sample in set(table["sample"][is_ok])
