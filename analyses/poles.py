"""Pole axes and velocity coefficients of links relative to each other.

What the analysis `poles` shows beside its plots: the lecture's chart, axodes, steps.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from spherekit.plugin import (
    ASSEMBLY_MODE,
    INPUT,
    RESIDUAL,
    SAMPLE,
    STATUS,
    AbstractAnalysis,
    Arrow,
    Axis,
    Batch,
    Column,
    Diagram,
    Floats,
    GreatCircle,
    Mechanism,
    Needs,
    Pole,
    Primitive,
    Scene,
    Series,
    Status,
    Table,
    TableData,
    Text,
    Trace,
    all_poles,
    link_bodies,
    parse_pole,
    pole_of,
)
from spherekit.plugin.designs import FigureOfMerit
from spherekit.plugin.motion import BlockPoles, LinePole, PrimaryPole, describe
from spherekit.plugin.rotations import link_axes, quaternion

REACH = 2.5
"""What of the chart is seen: tan xi and tan zeta up to this."""
PAIR_TONE = 0
POLE_TONE = 2


def chart(
    mechanism: Mechanism,
    poles: Sequence[Pole],
    directions: Floats,
    normals: Floats,
    words: Sequence[str] = (),
    moving: str = "",
) -> Diagram:
    """Return the gnomonic chart of axes (n, k, 3) of poles and great circles (n, m, 3).

    It is the plane that touches the sphere at x, seen from its centre. An axis (x, y, z)
    is the point (y/x, z/x) = (tan xi, tan zeta), a great circle a straight line (R. Di
    Gregorio, lecture 2, Barcelona 2019). Here x is the ground axis that is nearest to the
    middle of the ground's pairs, and y and z the two that follow. `moving` is the input
    that moves while others are locked.
    """
    ground = link_axes(mechanism)[mechanism.links[0]]
    x = int(np.argmax(np.abs(np.sum([*ground.values(), np.zeros(3)], axis=0))))
    y = (x + 1) % 3
    z = (x + 2) % 3
    with np.errstate(divide="ignore", invalid="ignore"):
        places = directions[..., [y, z]] / directions[..., [x]]
    places = np.where(np.isfinite(places), places, np.nan)
    primary = mechanism.pole_pairs
    return Diagram(
        f"plots/chart/{moving}" if moving else "plots/chart",
        f"{moving} moves: gnomonic chart" if moving else "gnomonic chart",
        f"tan ξ = {'xyz'[y]}/{'xyz'[x]}",
        f"tan ζ = {'xyz'[z]}/{'xyz'[x]}",
        (-REACH, REACH),
        (-REACH, REACH),
        [f"P{_short(mechanism, pole)}" for pole in poles],
        places,
        [PAIR_TONE if pole in primary else POLE_TONE for pole in poles],
        normals[..., [y, z, x]],
        words,
        np.arctan(places),
        ("ξ", "ζ"),
    )


def axode_traces(batch: Batch, pole: Pole, rows: slice) -> Iterator[Trace]:
    """Yield the fixed axode in the axes of the first link, the moving in the second's."""
    label = f"P{_short(batch.mechanism, pole)}"
    for number, kind in zip(pole, ("fixed", "moving"), strict=True):
        turn = batch.rotation(batch.mechanism.links[number])[rows]
        yield Trace(
            f"axode/{label}/{kind}",
            f"{kind} axode of {label}",
            np.einsum("nji,nj->ni", turn, batch.direction(*pole)[rows]),
            number,
            quaternion(turn) if number else None,
        )


def construction(batch: Batch, row: int) -> Scene:
    """Return a page on which row k is step k of the plan at one configuration.

    Poles appear as they are found, with the two great circles that give each.
    """
    mechanism = batch.mechanism
    plan = batch.plans[0]
    axes = [x for x in plan.steps if isinstance(x, PrimaryPole) and not x.round]
    primary = [step.pole for step in axes]
    words = [f"{len(primary)} axes of pairs are known"]
    every = list(plan.rounds)
    made: list[tuple[Sequence[Pole], bool]] = [(primary, False)]
    for step in plan.steps:
        if step in axes:
            continue
        if isinstance(step, BlockPoles):
            later = [passed.pole for passed in step.passes]
            made.append(([pole for pole in step.poles if pole not in later], False))
            made += [([pole], True) for pole in later]
        else:
            made.append(([step.pole], isinstance(step, LinePole)))
        words += describe(plan, step).split("\n")
    n = len(words)
    directions = np.full((n, len(every), 3), np.nan)
    circles = np.full((n, 2, 3), np.nan)
    for number, (new, on_circles) in enumerate(made):
        for pole in new:
            directions[number:, every.index(pole)] = batch.direction(*pole)[row]
            if on_circles:
                circles[number] = batch.planes(*pole)[row]
    turned = np.stack([batch.rotation(link)[row] for link in mechanism.links])
    names = [f"P{_short(mechanism, pole)}" for pole in every]
    listed = "\n".join(f"{k:3d}  {text}" for k, text in enumerate(words))
    parts: tuple[Primitive, ...] = (
        *link_bodies(mechanism, np.broadcast_to(turned, (n, *turned.shape))),
        *(
            Arrow(f"found/{name}", name, u, pole in primary, path_shown=False)
            for name, pole, u in zip(names, every, directions.swapaxes(0, 1), strict=True)
        ),
        *(
            GreatCircle(f"circle_{k}", f"great circle {k + 1}", circles[:, k])
            for k in (0, 1)
        ),
        chart(mechanism, every, directions, circles, words),
        Text("steps", "Steps", f"```\n{listed}\n```"),
    )
    return Scene("Construction", parts, (Axis("step", "", np.arange(float(n))),))


COEFFICIENTS = ("velocity_coefficient", "acceleration_coefficient")

MANY = 6
"""With more poles than this, those to the ground and the shown one are seen at first."""


@dataclass(frozen=True, kw_only=True)
class Poles(AbstractAnalysis):
    """Pole axis, velocity coefficient and its derivative for pairs of links.

    With several inputs these are of each single-freedom mechanism in which one input
    moves and the others are locked; the motion of all is their sum (superposition).
    `only` lists the poles wanted, such as ``31+42``; all by default. `circles` is the pole
    whose two great circles are drawn; by default the first secondary one. `axodes` lists
    the poles whose axodes are drawn: the cones that roll on each other.
    """

    name = "poles"
    version = "2"
    summary = "pole axes and velocity coefficients of all pairs of links"
    cites = (
        "R. Di Gregorio, Proc. IMechE C 225(9), 2011, 2062-2075",
        "R. Di Gregorio, Mechanism and Machine Theory 2024, 105720, eqs. (3), (5), (8)",
    )
    rowwise = True
    tables = (
        Table(
            "poles",
            "one row per sample, assembly mode, moving input and pair of links",
            (
                SAMPLE,
                ASSEMBLY_MODE,
                INPUT,
                Column("link", "", "the link that moves", "text"),
                Column("relative_to", "", "the link it is seen from", "text"),
                *(
                    Column(
                        f"u{axis}",
                        "",
                        f"pole axis, {axis} in ground axes",
                        scale="absolute",
                        turns="vector",
                    )
                    for axis in "xyz"
                ),
                *(
                    Column(
                        f"du{axis}_dq",
                        "1/rad",
                        f"derivative of u{axis} by q, where the coefficient is not too "
                        "small to know it",
                        scale="none",
                        turns="vector",
                    )
                    for axis in "xyz"
                ),
                Column(
                    "velocity_coefficient",
                    "",
                    "velocity coefficient: times u it is the angular velocity per unit "
                    "rate of q",
                ),
                Column(
                    "acceleration_coefficient",
                    "1/rad",
                    "acceleration coefficient: derivative of the velocity coefficient by q",
                ),
                Column(
                    "conditioning",
                    "",
                    "how far the angular velocities of both links are from cancelling: the "
                    "size of their difference over the sum of sizes; 1 for pairs",
                    scale="none",
                ),
                Column(
                    "error_bound",
                    "rad",
                    "bound of the error of u: of rounding and of the configuration",
                    scale="none",
                ),
                Column(
                    "velocity_coefficient_error_bound",
                    "",
                    "bound of the error of the velocity coefficient, likewise",
                    scale="none",
                ),
                Column(
                    "acceleration_coefficient_error_bound",
                    "1/rad",
                    "bound of the error of acceleration_coefficient, likewise",
                    scale="none",
                ),
                Column(
                    "direction_dq_error_bound",
                    "1/rad",
                    "bound of the error of du_dq, the length of the error vector, likewise",
                    scale="none",
                ),
                RESIDUAL,
                STATUS,
                Column("moving", "", "the moving input, the others locked", "text"),
            ),
        ),
    )

    only: tuple[str, ...] = ()
    circles: str = ""
    axodes: tuple[str, ...] = ()

    def poles(self, mechanism: Mechanism) -> tuple[Pole, ...]:
        """Return the wanted poles as pairs of link numbers."""
        if self.only:
            return tuple(dict.fromkeys(parse_pole(mechanism, text) for text in self.only))
        return all_poles(len(mechanism.links))

    def shown(self, mechanism: Mechanism) -> Pole | None:
        """Return the pole whose great circles are drawn, if any is secondary."""
        if self.circles:
            return parse_pole(mechanism, self.circles)
        primary = mechanism.pole_pairs
        return next((p for p in self.poles(mechanism) if p not in primary), None)

    def merits(self, mechanism: Mechanism) -> tuple[FigureOfMerit, ...]:
        """Return the largest coefficients: of the poles asked for, else of the outputs."""
        names = mechanism.links
        wanted = [(names[j], names[i]) for i, j in self.poles(mechanism)]
        if not self.only:
            given = [(output.link, output.relative_to) for output in mechanism.outputs]
            wanted = given or [(link, names[0]) for link in names[1:]]
        inputs = mechanism.input_pairs
        moving = [f"_by_{pair}" for pair in inputs] if len(inputs) > 1 else [""]
        return tuple(
            FigureOfMerit(
                f"largest_coefficient_{link}_{other}{by}",
                "max",
                f"abs(velocity_coefficient_{link}_{other}{by})",
                meaning=f"largest |velocity coefficient| of link {link} seen from {other}",
            )
            for link, other in wanted
            for by in moving
        )

    def needs(self, mechanism: Mechanism) -> Needs:
        """Return the wanted poles with their rates, derivatives and great circles."""
        drawn = self._drawn(mechanism)
        wanted = frozenset(self.poles(mechanism)) | frozenset(drawn)
        shown = self.shown(mechanism)
        planes = frozenset() if shown is None else frozenset([shown])
        stepwise = self._stepwise(mechanism)
        if stepwise:
            planes |= wanted - set(mechanism.pole_pairs)
        turned = {mechanism.links[link] for pole in drawn for link in pole}
        return Needs(
            directions=wanted,
            rates=wanted,
            derivatives=True,
            planes=planes,
            turns=wanted,
            rotations=frozenset(mechanism.links) if stepwise else frozenset(turned),
        )

    def _drawn(self, mechanism: Mechanism) -> tuple[Pole, ...]:
        """Return the poles whose axodes are drawn."""
        return tuple(parse_pole(mechanism, text) for text in self.axodes)

    def _stepwise(self, mechanism: Mechanism) -> bool:
        """Return whether the construction is shown step by step: of all poles, by one."""
        return not self.only and len(mechanism.inputs) == 1

    def compute(self, batch: Batch) -> Mapping[str, TableData]:
        """Return the table `poles`."""
        poles = self.poles(batch.mechanism)
        inputs = range(len(batch.moving_inputs))
        wanted = [(*pole, moved) for moved in inputs for pole in poles]
        of = batch.of_poles(wanted)
        made = dict[str, Any](batch.pole_columns(wanted))
        made["q"] = batch.interleaved([batch.inputs[:, moved] for *_, moved in wanted])
        made |= {f"du{axis}_dq": of("direction_dq", c) for c, axis in enumerate("xyz")}
        numbers = (
            "conditioning",
            "error_bound",
            *(f"{c}_error_bound" for c in COEFFICIENTS),
            "direction_dq_error_bound",
        )
        made |= {name: of(name, None) for name in numbers}
        (table,) = self.tables
        return {"poles": {column.name: made[column.name] for column in table.columns}}

    def scene(self, batch: Batch) -> tuple[Scene, ...]:
        """Return arrows along the poles, great circles of one, coefficient plots."""
        inputs = range(len(batch.moving_inputs))
        pages = [
            Scene(
                number,
                tuple(part for moved in inputs for part in self._parts(batch, rows, moved)),
            )
            for number, rows in batch.assembly_mode_rows().items()
        ]
        good = np.flatnonzero(batch.status == Status.OK)
        if len(good) and batch.sample[0] == 0 and self._stepwise(batch.mechanism):
            in_mode = good[batch.assembly_mode[good] == batch.assembly_mode[good[0]]]
            pages.append(construction(batch, int(in_mode[len(in_mode) // 3])))
        return tuple(pages)

    def _parts(self, batch: Batch, rows: slice, moved: int) -> Iterator[Primitive]:
        """Yield what is seen of one assembly mode while one input moves."""
        mechanism = batch.mechanism
        pair = batch.moving_inputs[moved]
        several = len(batch.moving_inputs) > 1
        home, alone, title = (
            (f"{pair}/", f" by {pair}", f"{pair} moves: ") if several else ("", "", "")
        )
        primary = mechanism.pole_pairs
        shown = self.shown(mechanism)
        driven = pole_of(*mechanism.ends[mechanism.pair_number[pair]])
        body = batch.plans[moved].body
        wanted = self.poles(mechanism)
        many = len(wanted) > MANY
        brief = all(len(name) == 1 for name in mechanism.links)
        for pole in wanted:
            low, high = (mechanism.links[k] for k in pole)
            short, is_primary = _short(mechanism, pole), pole in primary
            to_ground, where = pole[0] == 0, f"{home}{high}_{low}"
            if moved == 0 or not is_primary:
                first = moved == 0 and (to_ground or pole == shown)
                label = f"P{short}" if brief else f"{high}/{low}"
                label += "" if is_primary else alone
                u, seen = (
                    batch.direction(*pole, moved)[rows],
                    first or is_primary or not many,
                )
                yield Arrow(f"pole/{where}", label, u, is_primary, seen)
            if pole == driven or body[pole[0]] == body[pole[1]]:
                continue
            name = f"ω{short}/ω{_short(mechanism, driven)}" if brief else f"{high}/{low}"
            kind = (" to ground" if to_ground else " between links") if many else ""
            velocity = batch.velocity_coefficient(*pole, moved)
            acceleration = batch.acceleration_coefficient(*pole, moved)
            derived = f"({name})′" if brief else name
            if not batch.has_continuous_sign(*pole, moved):
                # Over a grid the axis may be turned round between neighbours. The size of
                # the coefficient is not, nor is the derivative of that size.
                acceleration = np.where(velocity < 0.0, -acceleration, acceleration)
                velocity = np.abs(velocity)
                name = f"|{name}|"
                derived = f"{name}′" if brief else name
            for order, letter, values, unit in (
                ("velocity", name, velocity, ""),
                ("acceleration", derived, acceleration, "1/rad"),
            ):
                group = f"{title}{order} coefficients{kind}"
                path, link = f"plots/{order}/{where}", pole[1] if to_ground else None
                yield Series(path, letter, group, values[rows], unit, link)
        for pole in () if moved else self._drawn(mechanism):
            yield from axode_traces(batch, pole, rows)
        if shown is None:
            return
        normals = batch.planes(*shown, moved)[rows]
        order_seen = sorted(wanted, key=lambda pole: (pole in primary, pole[0] != 0))
        u = np.stack([batch.direction(*p, moved)[rows] for p in order_seen], axis=1)
        yield chart(mechanism, order_seen, u, normals, moving=pair if several else "")
        for k in () if many and moved else (0, 1):
            yield GreatCircle(
                f"construction/{home}circle_{k}",
                f"great circle {k + 1} of P{_short(mechanism, shown)}{alone}",
                normals[:, k],
            )


def _short(mechanism: Mechanism, pole: Pole) -> str:
    low, high = (mechanism.links[k] for k in pole)
    return f"{high}{low}" if len(low) == len(high) == 1 else f"({high},{low})"
