"""Loads that change at once, by both engines against free bodies integrated by SciPy."""

from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
import pytest
from multibody import Hinge, MultiBody

from spherekit.dynamics.forward import simulate
from spherekit.engine.compiler import available
from spherekit.files.read import load
from spherekit.model.dynamics import Friction, Mass, PairTorque
from spherekit.model.laws import Start
from spherekit.motion.motion import Tracer

ENGINES = (
    pytest.param(
        "compiled",
        marks=pytest.mark.skipif(not available(), reason="heyoka is not installed"),
    ),
    "numpy",
)
START = Start(0.3, 1.0)
WITHIN = 1e-7
"""What both engines are held to (rad) at the default tolerance."""


def lonlat(lon, lat):
    """Return the unit vector of a longitude and a latitude (deg)."""
    lon, lat = np.radians([lon, lat])
    return np.array([np.cos(lat) * np.cos(lon), np.cos(lat) * np.sin(lon), np.sin(lat)])


def tensors(mechanism):
    """Return physical inertia tensors (links, 3, 3) in link axes."""
    random = np.random.default_rng(3)
    points = random.normal(size=(len(mechanism.links), 5, 3)) * 0.4
    square = np.einsum("lni,lnj->lij", points, points)
    return np.trace(square, axis1=1, axis2=2)[:, None, None] * np.eye(3) - square


def massive(mechanism):
    """Return a mechanism with these tensors, without loads."""
    masses = tuple(
        Mass(link, tuple(map(tuple, each.tolist())))
        for link, each in zip(mechanism.links, tensors(mechanism), strict=True)
        if link != mechanism.ground
    )
    return replace(mechanism, masses=masses, loads=())


@dataclass(frozen=True)
class Case:
    """A mechanism with its driven pair, and the two pairs that rub."""

    name: str
    driven: str
    rubbing: tuple[str, str]

    def mechanism(self):
        """Return it with masses: those of the file, or others."""
        made = load(self.name)
        return replace(made, loads=()) if made.masses else massive(made)

    def bodies(self):
        """Return it as free bodies at the start; an eccentric cam with its roller as R's.

        The centres of circle and roller are 25 + 12 degrees apart, which a link without
        mass keeps.
        """
        made = self.mechanism()
        motion = Tracer(made).at(np.array([START.q]))
        turn, number = motion.rotations[0], made.link_number
        own = np.zeros((len(made.links), 3, 3))
        for mass in made.masses:
            own[number[mass.link]] = np.array(mass.tensor)
        grounded = list(turn @ own @ np.swapaxes(turn, 1, 2))[1:]
        hinges = [
            Hinge(pair.name, *ends, motion.axes[0, k])
            for k, (pair, ends) in enumerate(zip(made.pairs, made.ends, strict=True))
            if pair.type == "R"
        ]
        if self.name == "roller_cam":
            centre = turn[number["cam"]] @ lonlat(90.0, 80.0)
            roller = turn[number["follower"]] @ lonlat(90.0, 45.0)
            assert abs(centre @ roller - np.cos(np.radians(37.0))) < 1e-12
            grounded.append(np.zeros((3, 3)))
            hinges += [
                Hinge("circle", number["cam"], len(grounded), centre),
                Hinge("roller", len(grounded), number["follower"], roller),
            ]
        return MultiBody(grounded, hinges)


CASES = {
    "four_bar": Case("four_bar", "21", ("43", "21")),
    "stephenson": Case("stephenson", "12", ("35", "14")),
    "cam": Case("roller_cam", "cam_shaft", ("cam_shaft", "follower_pivot")),
}
DRY, DRIVE, DAMPING = 0.2, 10.0, 2.0


def rubbed(case, speed, dry=DRY):
    """Return the mechanism with dry friction smoothed below a speed (rad/s), and driven."""
    made = case.mechanism()
    drive = f"{DRIVE!r}*sin(2*t) - {DAMPING!r}*dtheta_{case.driven}"
    loads = [PairTorque("drive", case.driven, drive)]
    loads += [Friction(f"rub_{k}", p, dry, 0.0, speed) for k, p in enumerate(case.rubbing)]
    return replace(made, loads=tuple(loads))


@lru_cache
def outside(name, speed, until, dry=DRY):
    """Return times, and the angles turned at the driven pair and at those that rub."""
    case = CASES[name]
    times = np.linspace(0.0, until, 31)

    def torque(t, angle, rate):
        acting = {pair: -dry * np.tanh(rate[pair] / speed) for pair in case.rubbing}
        driving = DRIVE * np.sin(2.0 * t) - DAMPING * rate[case.driven]
        return acting | {case.driven: acting.get(case.driven, 0.0) + driving}

    bodies = case.bodies()
    turned = bodies.solve(torque, bodies.rates(case.driven, START.dq), times)
    return times, {pair: turned[pair] for pair in {case.driven, *case.rubbing}}


def off(found, times, turned):
    """Return the largest difference (rad) of a simulation from the angles turned."""
    mechanism = found.mechanism
    values = found.at(times).values
    worst = 0.0
    for pair, expected in turned.items():
        (column,) = mechanism.variables_of(mechanism.pair_number[pair])
        own = values[:, column] - values[0, column]
        worst = max(worst, float(np.max(np.abs(own - expected))))
    return worst


def holds(name, speed, until, engine, dry=DRY):
    """Check a simulation: within the bound, or it says that it misses its tolerance."""
    times, turned = outside(name, speed, until, dry)
    made = rubbed(CASES[name], speed, dry)
    found = simulate(made, START, until, engine=engine, check=True)
    assert found.end.kind == "time"
    assert found.missed is not None or off(found, times, turned) < WITHIN
    return found


@pytest.mark.slow
@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize(
    ("name", "speed"), [("four_bar", 0.5), ("stephenson", 0.05), ("cam", 0.01)]
)
def test_dry_friction_is_that_of_an_outside_integrator(name, speed, engine):
    found = holds(name, np.deg2rad(speed), 2.0, engine)
    assert found.missed is None


@pytest.mark.parametrize("engine", ENGINES)
def test_sticking_is_that_of_an_outside_integrator(engine):
    """Friction of up to 6 N m holds against 10 sin 2t N m, lets go, and holds again."""
    found = holds("four_bar", np.deg2rad(0.5), 2.0, engine, 6.0)
    assert found.missed is None
    rates = found.at(np.linspace(0.0, 2.0, 201)).dq
    assert np.min(np.abs(rates)) < 1e-3 < np.max(np.abs(rates))


@pytest.mark.long
@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize("speed", [0.01, 0.05, 0.5, 1.0, 5.0, 20.0])
@pytest.mark.parametrize("name", CASES)
@pytest.mark.parametrize("dry", [DRY, 6.0])
def test_dry_friction_of_every_speed(name, speed, dry, engine):
    holds(name, np.deg2rad(speed), 5.0, engine, dry)
