"""What the analysis `poles` shows beside its plots: the lecture's chart, axodes, steps."""

from collections.abc import Sequence
from typing import final

import numpy as np

from spherekit.plugin import (
    Arrow,
    Axis,
    Batch,
    Diagram,
    Floats,
    GreatCircle,
    Mechanism,
    Pole,
    Primitive,
    Scene,
    Text,
    Trace,
    link_bodies,
    pole_of,
)
from spherekit.plugin.motion import BlockPoles, LinePole, Plan, PrimaryPole, describe
from spherekit.plugin.rotations import quaternion

REACH = 2.5
"""What of the chart is seen: tan xi and tan zeta up to this."""
PAIR_TONE, POLE_TONE = 0, 2


@final
class Chart:
    """The gnomonic chart: the plane that touches the sphere at x, seen from its centre.

    An axis (x, y, z) is the point (y/x, z/x) = (tan xi, tan zeta), a great circle a
    straight line (R. Di Gregorio, lecture 2, Barcelona 2019). Here x is the ground axis
    that is nearest to the middle of the ground's pairs, and y and z the two that follow.
    """

    def __init__(self, mechanism: Mechanism, ground: Floats) -> None:
        """Choose the axes of the chart by the pair axes (k, 3) of the ground."""
        middle = np.sum(ground, axis=0) if len(ground) else np.array([1.0, 0.0, 0.0])
        self.first = int(np.argmax(np.abs(middle)))
        self.order = [(self.first + k) % 3 for k in range(3)]
        self.names = ["xyz"[k] for k in self.order]

    def points(self, directions: Floats) -> Floats:
        """Return (tan xi, tan zeta) (..., 2) of axes (..., 3); NaN at infinity."""
        x, y, z = (directions[..., k] for k in self.order)
        with np.errstate(divide="ignore", invalid="ignore"):
            tangents = np.stack([y / x, z / x], axis=-1)
        return np.where(np.isfinite(tangents), tangents, np.nan)

    def lines(self, normals: Floats) -> Floats:
        """Return lines (..., 3), as in `Diagram`, of great circles by normals (..., 3)."""
        x, y, z = (normals[..., k] for k in self.order)
        return np.stack([y, z, x], axis=-1)

    def diagram(
        self,
        names: Sequence[str],
        directions: Floats,
        tones: Sequence[int],
        normals: Floats,
        words: Sequence[str] = (),
        moving: str = "",
    ) -> Diagram:
        """Return the chart of axes (n, k, 3) and great circles (n, m, 3).

        `moving` is the input that moves while others are locked.
        """
        first, second, third = self.names
        places = self.points(directions)
        return Diagram(
            f"plots/chart/{moving}" if moving else "plots/chart",
            f"{moving} moves: gnomonic chart" if moving else "gnomonic chart",
            f"tan ξ = {second}/{first}",
            f"tan ζ = {third}/{first}",
            (-REACH, REACH),
            (-REACH, REACH),
            names,
            places,
            tones,
            self.lines(normals),
            words,
            np.arctan(places),
            ("ξ", "ζ"),
        )


def axode_traces(batch: Batch, pole: Pole, label: str, rows: slice) -> list[Primitive]:
    """Return the fixed axode in the axes of the first link, the moving in the second's."""
    u = batch.direction(*pole)[rows]
    traces: list[Primitive] = []
    for number, kind in zip(pole, ("fixed", "moving"), strict=True):
        link = batch.mechanism.links[number]
        turn = batch.rotation(link)[rows]
        traces.append(
            Trace(
                f"axode/{label}/{kind}",
                f"{kind} axode of {label}",
                np.einsum("nji,nj->ni", turn, u),
                number,
                quaternion(turn) if number else None,
            )
        )
    return traces


def _two_circles(batch: Batch, step: LinePole, row: int) -> Floats:
    """Return the normals (2, 3) of the two great circles of a step that cross most."""
    if step.contacts:
        return np.asarray(batch.planes(*step.pole)[row])
    i, j = step.pole
    normals = np.stack(
        [
            np.cross(
                batch.direction(*pole_of(i, k))[row], batch.direction(*pole_of(j, k))[row]
            )
            for k in step.via
        ]
    )
    length = np.linalg.norm(normals, axis=1, keepdims=True)
    normals = normals / np.where(length > 0.0, length, np.nan)
    across = np.linalg.norm(np.cross(normals[:, None], normals[None]), axis=2)
    one, other = np.unravel_index(int(np.argmax(np.nan_to_num(across))), across.shape)
    return np.asarray(normals[[one, other]])


def construction(
    batch: Batch, plan: Plan, chart: Chart, row: int, names: dict[Pole, str]
) -> Scene:
    """Return a page on which row k is step k of a plan at one configuration.

    Poles appear as they are found, with the two great circles that give each.
    """
    mechanism = batch.mechanism
    primary = [step.pole for step in plan.steps if isinstance(step, PrimaryPole)]
    stages: list[tuple[Pole, ...]] = [tuple(primary)]
    words = [f"{len(primary)} axes of pairs are known"]
    by_lines: dict[int, LinePole] = {}
    for step in plan.steps:
        if isinstance(step, PrimaryPole):
            continue
        said = describe(plan, step).split("\n")
        if isinstance(step, LinePole):
            by_lines[len(stages)] = step
        if not isinstance(step, BlockPoles):
            stages.append((step.pole,))
            words += said
            continue
        later = {passed.pole for passed in step.passes}
        stages.append(tuple(pole for pole in step.poles if pole not in later))
        for line_step in step.passes:
            by_lines[len(stages)] = line_step
            stages.append((line_step.pole,))
        words += said
    n, every = len(stages), list(plan.rounds)
    directions = np.full((n, len(every), 3), np.nan)
    circles = np.full((n, 2, 3), np.nan)
    for number, new in enumerate(stages):
        for pole in new:
            directions[number:, every.index(pole)] = batch.direction(*pole)[row]
        if number in by_lines:
            circles[number] = _two_circles(batch, by_lines[number], row)
    turned = np.stack([batch.rotation(link)[row] for link in mechanism.links])
    parts: list[Primitive] = [
        *link_bodies(mechanism, np.broadcast_to(turned, (n, *turned.shape)))
    ]
    for k, pole in enumerate(every):
        parts.append(
            Arrow(
                f"found/{names[pole]}",
                names[pole],
                directions[:, k],
                pole in primary,
                path_shown=False,
            )
        )
    parts += [
        GreatCircle(f"circle_{k}", f"great circle {k + 1}", circles[:, k]) for k in (0, 1)
    ]
    tones = [PAIR_TONE if pole in primary else POLE_TONE for pole in every]
    labels = [names[pole] for pole in every]
    parts.append(chart.diagram(labels, directions, tones, circles, words))
    listed = "\n".join(f"{k:3d}  {text}" for k, text in enumerate(words))
    parts.append(Text("steps", "Steps", f"```\n{listed}\n```"))
    over = Axis("step", "", np.arange(float(n)))
    return Scene("Construction", tuple(parts), (over,))
