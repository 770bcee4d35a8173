"""Forces through the centre and loads of bearings, against links held by these alone."""

from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from helpers.refusals import mechanism_text
from mechanism_examples.named_mechanisms import one_link_mechanism
from oracles.newton_euler import bearing_forces, row_of_torques, with_masses_and_loads
from test_reactions import STARTS, moving

import spherekit as sk
from spherekit.dynamics.reactions import reactions

PLACES, TEETH = (0.4, 0.9), np.radians(20.0)
STARTS = STARTS | {"bevel_differential": (0.3, 0.2)}


def borne(name, seed=3, distance=0.7):
    """Return a mechanism with bearings in all R pairs, as many floating as is needed."""
    made, joint = with_masses_and_loads(name, np.random.default_rng(seed))
    made = made.with_inputs(*[item.pair for item in made.inputs])
    pairs = tuple(
        pair
        if pair.kind.has_axis
        else replace(
            pair, distance=distance, pressure_angle=TEETH if pair.type == "Cr" else None
        )
        for pair in made.pairs
    )
    made = replace(made, pairs=pairs)
    needed = reactions(moving(made, STARTS[name], [0.0, 0.2])).lacking
    assert needed.enough and not needed.centres and not needed.distances
    bearings = [
        sk.Bearings(
            f"at_{pair.name}",
            pair.name,
            PLACES,
            axial=(0.0, 0.0) if pair.name in needed.floating else (1.0, 0.0),
        )
        for pair in made.pairs
        if pair.kind.has_axis
    ]
    return made.with_loads(*made.loads, *bearings), joint


@pytest.mark.many
@pytest.mark.parametrize("name", STARTS)
def test_links_that_bearings_alone_hold_give_the_same_loads(name):
    made, joint = borne(name)
    found = reactions(moving(made, STARTS[name], [0.0, 0.2]))
    assert not np.any(found.open_forces) and not found.lacking.wanted
    torques = found.torques
    for row in range(len(torques.t)):
        given = row_of_torques(torques, row, joint)
        meshes = [pair.name for pair in made.pairs if pair.pressure_angle is not None]
        solved = [
            bearing_forces(*given, dict(zip(meshes, sides, strict=True)))
            for sides in product((1.0, -1.0), repeat=len(meshes))
        ]
        # Of the flanks those that push are the ones that touch.
        ((forces, loose, missed),) = [
            one
            for one in solved
            if all(
                one[0][name, 0] @ found.frames[row, made.pair_number[name]][:, 1] < 0.0
                for name in meshes
            )
        ]
        size = max(np.max(np.abs(force)) for force in forces.values())
        assert loose == 0 and missed < 1e-12 * size
        for k, pair in enumerate(made.pairs):
            frame = found.frames[row, k]
            if pair.kind.has_axis:
                on_bearings = found.on_bearings[f"at_{pair.name}"][row] @ frame.T
                want = np.array([forces[f"at_{pair.name}", n] for n in (0, 1)])
            else:
                on_bearings = found.forces[row, k] @ frame.T
                want = forces[pair.name, 0]
            assert on_bearings == pytest.approx(want, abs=1e-11 * size)


SHAFT = mechanism_text("shaft")


def test_a_vertical_shaft_stands_on_its_fixed_bearing(tmp_path, capsys):
    """By hand: 10 kg, 0.1 m beside the axis and 0.3 m up, on bearings at 0.2 and 0.7 m.

    At rest the fixed bearing carries the weight, 98.1 N, and both the couple 9.81 N m over
    0.5 m, the upper one inwards. Turning at w the shaft pulls outwards with 10 0.1 w^2 N
    at 0.3 m, of which the bearing at 0.2 m has 4/5 and that at 0.7 m 1/5.
    """
    (tmp_path / "shaft.toml").write_text(SHAFT)
    for speed in (0.0, 6.0):
        found = reactions(
            moving(sk.load(tmp_path / "shaft.toml"), (0.4,), [0.0], speed, 0.0)
        )
        ((first, second),) = found.on_bearings["bearings"]
        frame = found.frames[0, 0]
        # Outwards is x of the shaft, which is turned by its angle.
        outwards = np.array([np.cos(0.4), np.sin(0.4), 0.0])
        radial = np.array([frame @ first, frame @ second]) @ outwards
        pull = speed**2
        assert radial == pytest.approx([19.62 - 0.8 * pull, -19.62 - 0.2 * pull])
        assert [first[2], second[2]] == pytest.approx([98.1, 0.0], abs=1e-12)
    from spherekit.cli.main import main

    out = str(tmp_path / "out")
    run = ["run", str(tmp_path / "shaft.toml"), "-a", "reactions", "--samples", "3"]
    assert main([*run, "--out", out]) == 0
    assert "largest axial load of a bearing: 98.1 N" in capsys.readouterr().out
    rows = (tmp_path / "out" / "reactions_bearings.csv").read_text().splitlines()
    assert len(rows) == 7 and "radial,axial,status" in rows[0]
    sliding = SHAFT.replace("axial = [1, 0]", "axial = [0, 0]")
    (tmp_path / "shaft.toml").write_text(sliding)
    assert main(run) == 0
    said = capsys.readouterr()
    assert "none holds the links shaft in the centre" in said.out + said.err
    again = tmp_path / "again.toml"
    sk.dump(sk.load(tmp_path / "shaft.toml"), again)
    assert sk.load(again).loads[1].axial == (0.0, 0.0)
    for wrong in ("[1]", "[0.5, 0.6]", "[2, -1]"):
        (tmp_path / "shaft.toml").write_text(SHAFT.replace("[1, 0]", wrong))
        with pytest.raises(sk.SpherekitError, match="axial"):
            sk.load(tmp_path / "shaft.toml")


def test_a_spinning_shaft_is_slowed_by_its_weight_on_the_fixed_bearing():
    """By hand: balanced, it presses on it with m g along the axis alone.

    So C a = -c r m g, and the angle is w t - c r m g t^2 / (2 C).
    """
    rub = sk.Bearings("rub", "12", (0.2, 0.7), 0.05, 0.4, 1e-3, axial=(1.0, 0.0))
    loads, up = (sk.Gravity("weight", (0.0, 0.0, -10.0)), rub), (0.0, 0.0, 1.0)
    tensor, centre = np.diag([0.5, 0.5, 0.2]), (0.0, 0.0, 0.3)
    made = one_link_mechanism(tensor, *loads, mass=4.0, centre=centre, axis=up)
    slowed = 0.4 * 0.05 * 40.0 / 0.2
    found = sk.simulate(made, sk.Start(0.0, 9.0), 1.0)
    history = found.at([0.5, 1.0])
    assert history.q == pytest.approx([4.5 - slowed / 8.0, 9.0 - slowed / 2.0], abs=1e-9)
    without = made.with_loads(made.loads[0], replace(rub, axial=None))
    free = sk.simulate(without, sk.Start(0.0, 9.0), 1.0).at([1.0])
    assert free.q[0] == pytest.approx(9.0)
    loose = made.with_loads(made.loads[0], replace(rub, axial=(0.0, 0.0)))
    with pytest.raises(sk.SpherekitError, match="the force through the centre in pair"):
        sk.simulate(loose, sk.Start(0.0, 9.0), 1.0)


def test_friction_follows_from_radial_and_axial_forces():
    """The torque c r sum of |forces on the bearings|, put in as a load, needs the same."""
    made, _ = borne("stephenson")
    name = made.pairs[2].name
    loads = [
        replace(x, radius=0.02, coefficient=0.3, speed=0.01)
        if isinstance(x, sk.Bearings) and x.pair == name
        else x
        for x in made.loads
    ]
    rub = next(x for x in loads if isinstance(x, sk.Bearings) and x.pair == name)
    found = reactions(moving(made.with_loads(*loads), (0.4,), [0.1]))
    torques = found.torques
    rate = torques.rates[0, :, made.angles[name]] @ torques.input_rates[0]
    size = np.sum(np.linalg.norm(found.on_bearings[rub.name][0], axis=1))
    torque = -0.3 * 0.02 * size * np.tanh(rate / 0.01)
    given = made.with_loads(*made.loads, sk.PairTorque("rub_", name, repr(float(torque))))
    same = reactions(moving(given, (0.4,), [0.1]))
    assert same.forces == pytest.approx(found.forces, rel=1e-11, abs=1e-11)
    assert same.torques.tau == pytest.approx(torques.tau, rel=1e-12)
    plain = reactions(moving(made, (0.4,), [0.1])).torques.tau
    assert abs(plain[0] - torques.tau[0]) > 1e-3


def test_what_would_determine_the_forces_is_said():
    made, _ = with_masses_and_loads("stephenson", np.random.default_rng(3))
    light = replace(made.masses[2], mass=None, centre=None)
    masses = (*made.masses[:2], light, *made.masses[3:])
    made = replace(made, masses=masses, loads=made.loads[1:])
    found = reactions(moving(made, STARTS["stephenson"], [0.0]))
    assert found.lacking.centres == (light.link,)
    assert len(found.lacking.floating) == 6 and np.all(found.open_forces)
    run = sk.run(made, "reactions", samples=3)
    (analysis,) = run.summary["analyses"]
    need = analysis["findings"]["forces_need"]
    assert need["centres_of_mass"] == [light.link] and len(need["floating_pairs"]) == 6


def test_gears_keep_their_pressure_angle_and_distance_in_files(tmp_path):
    made, _ = borne("bevel_differential")
    sk.dump(made, tmp_path / "gears.toml")
    again = sk.load(tmp_path / "gears.toml")
    assert [x.pressure_angle for x in again.pairs] == pytest.approx(
        [x.pressure_angle for x in made.pairs]
    )
    assert [x.distance for x in again.pairs] == [x.distance for x in made.pairs]
    with pytest.raises(sk.SpherekitError, match="pressure_angle: found 2 rad"):
        pairs = [replace(x, pressure_angle=2.0) if x.distance else x for x in made.pairs]
        replace(made, pairs=tuple(pairs))
