"""A mechanism as rigid bodies on hinges with cut loops, and as a MuJoCo model.

General engines move bodies of a tree and close loops by constraints. Two bodies that turn
about the centre O of the sphere share an axis if one point of it coincides in both. The
usual three equations for a point have rank two then, since the radial one is empty. An
engine that weighs constraints by the mobility of centres of mass needs centres away from
O, or it is wrong by radians without a word.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import final
from xml.sax.saxutils import quoteattr

import numpy as np

from spherekit.checked import checked
from spherekit.conventions import listing
from spherekit.dynamics.inertia import need_inertia
from spherekit.errors import ModelError
from spherekit.model.dynamics import Damper, Gravity, Spring
from spherekit.model.geometry import geometry_of
from spherekit.model.inertia import moments_of_point
from spherekit.model.mechanism import Mechanism
from spherekit.motion.closure import Closure
from spherekit.sphere.rotation import Floats

SMALL = 1e-6
"""Bodies without inertia get this part of the largest one: no engine moves massless
bodies."""

STIFF = 0.3
"""Rate of the loops' correction times the step; RK4 is stable to about 1."""

THICKNESS = 1e-11
"""Part of its trace added to each moment of a tensor: for a thin arc two moments add up to
the third, and MuJoCo refuses what rounding takes beyond that."""


@final
@dataclass(frozen=True)
class Hinge:
    """A pair of the tree that turns link `child` about a fixed axis of link `parent`.

    `axis` (3,) is a unit vector along which the pair variable, which is `value` (rad) in
    the pose given, is positive.
    """

    pair: str
    parent: str
    child: str
    axis: Floats
    value: float


@final
@dataclass(frozen=True)
class LoopCut:
    """A pair that closes a loop: links `first` and `second` share `point` (3,)."""

    pair: str
    first: str
    second: str
    point: Floats


@final
@dataclass(frozen=True)
class BodyInertia:
    """Mass (kg), centre of mass (3,) and tensor (3, 3) about it, in m and kg m2.

    `known` says whether the mass is the link's own. Otherwise it is one that has the right
    tensor about O, which alone matters where no gravity acts.
    """

    link: str
    mass: float
    centre: Floats
    tensor: Floats
    known: bool


@final
@dataclass(frozen=True)
class RigidBodies:
    """A mechanism of R pairs in one pose, in ground axes, all bodies' origins at O.

    Hinges come depth first, each subtree in one piece, as Pinocchio takes for granted;
    body k is the child of hinge k.
    """

    mechanism: Mechanism
    hinges: tuple[Hinge, ...]
    cuts: tuple[LoopCut, ...]
    bodies: tuple[BodyInertia, ...]


def rigid_bodies(mechanism: Mechanism, values: Floats) -> RigidBodies:
    """Return the bodies, hinges and cut loops of a mechanism.

    Parameters
    ----------
    mechanism
        A mechanism of R pairs with masses.
    values
        (variables,) the closed configuration to give.

    Raises
    ------
    ModelError
        If a pair is a contact, no moving link has inertia, or the variables are not as
        many as there are.
    """
    for pair in mechanism.pairs:
        if not pair.kind.has_axis:
            raise ModelError(
                f"{mechanism.name}: pair {pair.name} is a {pair.type} pair; only R pairs "
                "are hinges of rigid bodies"
            )
    need_inertia(mechanism)
    values = np.asarray(values, dtype=float)
    count = len(mechanism.variable_names)
    if values.shape != (count,) or not np.all(np.isfinite(values)):
        raise ModelError(
            f"{mechanism.name}: a configuration has {count} finite variables "
            f"({listing(mechanism.variable_names)}), not {values.tolist()}"
        )
    closure = Closure.of(mechanism, geometry_of(mechanism).joints)
    at = closure.at(values[None])
    axes = at.frames[0, :, :, 2]
    links, pairs, ends = mechanism.links, mechanism.pairs, mechanism.ends
    hinges = tuple(
        Hinge(
            pairs[pair].name,
            links[parent],
            links[child],
            axes[pair] if ends[pair][0] == parent else -axes[pair],
            float(values[mechanism.variables_of(pair)[0]]),
        )
        for pair, parent, child in _depth_first(closure.tree.placements, 0)
    )
    cuts = tuple(
        LoopCut(pairs[k].name, links[ends[k][0]], links[ends[k][1]], axes[k])
        for k in closure.tree.chords
    )
    bodies = tuple(
        _body(mechanism, hinge.child, at.placed[0, mechanism.link_number[hinge.child]])
        for hinge in hinges
    )
    return RigidBodies(mechanism, hinges, cuts, bodies)


def _depth_first(
    assembly_modes: Sequence[tuple[int, int, int]], root: int
) -> list[tuple[int, int, int]]:
    found: list[tuple[int, int, int]] = []
    for assembly_mode in assembly_modes:
        if assembly_mode[1] == root:
            found += [assembly_mode, *_depth_first(assembly_modes, assembly_mode[2])]
    return found


def _body(mechanism: Mechanism, link: str, turn: Floats) -> BodyInertia:
    masses = {mass.link: mass for mass in mechanism.masses}
    if link in masses:
        given = masses[link]
        about_O = turn @ np.array(given.tensor) @ turn.T
        if given.mass is not None and given.centre is not None:
            centre = turn @ np.array(given.centre)
            return BodyInertia(
                link, given.mass, centre, _moved(about_O, given.mass, centre), True
            )
    else:
        most = max(float(np.trace(np.array(m.tensor))) for m in mechanism.masses)
        about_O = SMALL * most * np.diag([1.0, 1.0, 1.0])
    # The second moments of the mass: one body of many has all of it at unit distance from
    # O, and its centre halfway to where the moments would allow none beyond.
    moments = 0.5 * np.trace(about_O) * np.eye(3) - about_O
    spread, directions = np.linalg.eigh(moments)
    mass = float(np.trace(moments))
    centre = 0.5 * np.sqrt(spread[-1] / mass) * directions[:, -1]
    return BodyInertia(link, mass, centre, _moved(about_O, mass, centre), False)


def _moved(about_O: Floats, mass: float, centre: Floats) -> Floats:
    tensor = about_O - moments_of_point(mass, centre)
    return np.asarray(0.5 * (tensor + tensor.T))


@checked(ModelError)
def mjcf(mechanism: Mechanism, values: Floats, timestep: float = 1e-3) -> str:
    """Return a MuJoCo model (MJCF) of a mechanism in a closed configuration.

    Joint positions are the pair variables. Each cut loop is held by one `connect` at unit
    distance on the pair's axis, as stiff as the step allows. Gravity, springs and dampers
    at hinges are exported, other loads are not: every hinge has a motor whose control is
    a torque (N m). What is left out is said in comments, and by `left_out`.

    Parameters
    ----------
    mechanism, values
        As for `rigid_bodies`.
    timestep
        Step (s) of MuJoCo's integrator; the stiffness of the loops follows from it.
    """
    if not 0.0 < timestep < np.inf:
        raise ModelError(f"mjcf: timestep is {timestep} s; it has to be above 0")
    made = rigid_bodies(mechanism, values)
    loads, _ = _at_hinges(made)
    falls = [m.acceleration for m in mechanism.loads if isinstance(m, Gravity)]
    gravity = np.sum(np.array(falls).reshape(-1, 3), axis=0)
    notes = [f"cut at pair {cut.pair}: connect, of rank two" for cut in made.cuts]
    notes += left_out(made)
    lines = [f"<mujoco model={quoteattr(mechanism.name)}>"]
    lines += [f"  <!-- {note.replace('--', '- -')} -->" for note in notes]
    lines += [
        '  <compiler angle="radian" autolimits="true"/>',
        f'  <option timestep="{timestep!r}" integrator="RK4" gravity="{_text(gravity)}">',
        '    <flag contact="disable"/>',
        "  </option>",
        "  <worldbody>",
        *_children(made, mechanism.ground, loads, "    "),
        "  </worldbody>",
        "  <equality>",
    ]
    rate = STIFF / timestep
    hold = f'solref="{-(rate**2)!r} {-2.0 * rate!r}" solimp="0.9999 0.9999 1 0.5 2"'
    lines += [
        f'    <connect body1="{_body_name(made, cut.first)}" '
        f'body2="{_body_name(made, cut.second)}" anchor="{_text(cut.point)}" {hold}/>'
        for cut in made.cuts
    ]
    lines += ["  </equality>", "  <actuator>"]
    lines += [f'    <motor name="{h.pair}" joint="{h.pair}"/>' for h in made.hinges]
    return "\n".join([*lines, "  </actuator>", "</mujoco>", ""])


def left_out(made: RigidBodies) -> tuple[str, ...]:
    """Return what of a mechanism its MuJoCo model has otherwise or not, in sentences."""
    mechanism = made.mechanism
    weighed = {mass.link for mass in mechanism.masses}
    massless = [body.link for body in made.bodies if body.link not in weighed]
    unknown = [b.link for b in made.bodies if not b.known and b.link in weighed]
    _, lost = _at_hinges(made)
    notes = []
    if lost:
        notes.append(
            f"loads left out: {', '.join(lost)}; give them as controls of the motors"
        )
    if mechanism.stops:
        pairs = listing(stop.pair for stop in mechanism.stops)
        notes.append(f"stops left out, hinges turn freely: {pairs}")
    if mechanism.outputs:
        names = listing(output.name for output in mechanism.outputs)
        notes.append(f"outputs left out: {names}")
    if unknown:
        notes.append(
            f"mass and centre are not known and were chosen so that the tensor about the "
            f"centre of the sphere is right: links {listing(unknown)}"
        )
    if massless:
        notes.append(
            f"links without mass were given {SMALL:g} of the largest inertia: "
            f"{listing(massless)}"
        )
    return tuple(notes)


def _at_hinges(made: RigidBodies) -> tuple[dict[str, list[float]], list[str]]:
    """Return stiffness, rest and damping at every hinge, and the loads left out."""
    found = {hinge.pair: [0.0, 0.0, 0.0] for hinge in made.hinges}
    left = []
    for load in made.mechanism.loads:
        if isinstance(load, Gravity):
            continue
        reason = "MuJoCo has none of its kind"
        if isinstance(load, Spring | Damper):
            if load.pair not in found:
                reason = f"pair {load.pair}, where the loop is cut, has no hinge"
            elif isinstance(load, Damper):
                found[load.pair][2] += load.damping
                continue
            elif found[load.pair][0] == 0.0:
                found[load.pair][:2] = [load.stiffness, load.rest]
                continue
            else:
                reason = f"a hinge has one spring, and pair {load.pair} has another"
        left.append(f"{load.name} ({reason})")
    return found, left


def _children(
    made: RigidBodies, link: str, loads: dict[str, list[float]], space: str
) -> list[str]:
    lines: list[str] = []
    for hinge, body in zip(made.hinges, made.bodies, strict=True):
        if hinge.parent != link:
            continue
        t = body.tensor + THICKNESS * np.trace(body.tensor) * np.eye(3)
        inner = [t[0, 0], t[1, 1], t[2, 2], t[0, 1], t[0, 2], t[1, 2]]
        stiffness, rest, damping = loads[hinge.pair]
        lines += [
            f'{space}<body name="{hinge.child}">',
            f'{space}  <joint name="{hinge.pair}" type="hinge" axis="{_text(hinge.axis)}" '
            f'ref="{hinge.value!r}" stiffness="{stiffness!r}" springref="{rest!r}" '
            f'damping="{damping!r}"/>',
            f'{space}  <inertial mass="{body.mass!r}" pos="{_text(body.centre)}" '
            f'fullinertia="{_text(inner)}"/>',
            *_children(made, hinge.child, loads, space + "  "),
            f"{space}</body>",
        ]
    return lines


def _body_name(made: RigidBodies, link: str) -> str:
    return "world" if link == made.mechanism.ground else link


def _text(numbers: object) -> str:
    return " ".join(repr(float(x)) for x in np.asarray(numbers).ravel())
