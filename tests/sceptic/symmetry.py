"""The same mechanism told otherwise: turned, by its pose, with other names."""

from dataclasses import replace

import numpy as np
import pandas as pd
from chains import vector
from mechanism_strategies import reordered, turned
from sceptic.evidence import Kind, check
from sceptic.modes import CLEAR
from scipy.spatial.transform import Rotation

import spherekit as sk
from spherekit.conventions import Status
from spherekit.guarantee import Guarantee
from spherekit.model.mechanism import Mechanism
from spherekit.model.parts import PoseGeometry
from spherekit.motion.motion import Tracer
from spherekit.sphere.rotation import Floats

SAMPLES = 7
SAME = 1e-6
STILL = 1e-9
"""Rates below this have no sign."""
AGREE = 1e-7
"""Part of the largest rate by which rates may differ, over the conditioning of rows."""


def told_otherwise(evidence):
    """Return the mechanism by its pose at some sample, turned, renamed and reordered.

    None where nothing of it closes. Masses, loads, stops and outputs are left out.
    """
    made = evidence.tracer.mechanism
    bare = replace(made, masses=(), loads=(), stops=(), outputs=())
    if not isinstance(made.geometry, PoseGeometry):
        if any(pair.type != "R" for pair in made.pairs):
            return None  # profiles are told in link axes, which would change
        motion = evidence.motion
        good = np.flatnonzero((motion.status == Status.OK) & (motion.conditioning < CLEAR))
        if not len(good):
            return None
        row = int(good[evidence.random.integers(len(good))])
        axes = {p.name: vector(motion.axes[row, k]) for k, p in enumerate(made.pairs)}
        value = {
            made.pairs[owner].name: float(motion.values[row, k])
            for k, owner in enumerate(made.variable_owners)
        }
        bare = replace(bare, geometry=PoseGeometry(axes, value))
    turn = Rotation.random(random_state=int(evidence.random.integers(1 << 30)))
    other, _ = reordered(bare, evidence.random.permutation(len(bare.links) - 1).tolist())
    found: Mechanism = turned(other, turn.as_matrix())
    return found


def _angles(motion, sample):
    """Return cosines between pair axes at a sample, and a volume of mixed ones, (n, k).

    By names of pairs: no naming, order or turn of the whole changes them, and mirror
    images differ in the volume.
    """
    order = np.argsort([pair.name for pair in motion.mechanism.pairs])
    fine = (motion.sample == sample) & (motion.status == Status.OK)
    fine &= motion.conditioning < CLEAR
    axes = motion.axes[fine][:, order]
    cosines = axes @ axes.transpose(0, 2, 1)
    mixed = np.sin(np.arange(1.0, 3.0 * axes.shape[1] + 1.0)).reshape(3, -1) @ axes
    triple = np.linalg.det(mixed)
    return np.concatenate(
        [cosines.reshape(len(axes), len(order) ** 2), triple[:, None]], axis=1
    )


@check("told otherwise: modes", "by its pose, turned and renamed it has the same modes")
def same_modes(evidence, notes):
    """Compare what does not depend on names and axes, at a few inputs."""
    other = told_otherwise(evidence)
    if other is None:
        return
    one = Tracer(replace(evidence.tracer.mechanism), samples=SAMPLES)
    two = Tracer(other, samples=SAMPLES)
    first, second = one.motion(), two.motion()
    for sample in range(1, SAMPLES - 1):
        ours, theirs = _angles(first, sample), _angles(second, sample)
        where = np.degrees(first.inputs[first.sample == sample][0]).round(6).tolist()
        for here, there, claim, who in (
            (ours, theirs, two.claim, "told otherwise"),
            (theirs, ours, one.claim, "as it is given"),
        ):
            notes.judged(len(here))
            if not len(here):
                continue
            gap = np.full(len(here), np.inf)
            if len(there):
                gap = np.min(np.max(np.abs(here[:, None] - there[None]), axis=2), axis=1)
            lost = int(np.sum(gap > SAME))
            if lost:
                complete = claim.guarantee is Guarantee.COMPLETE
                notes.found(
                    f"{lost} of {len(here)} modes at inputs {where} deg are missing {who}; "
                    f'it claims "{claim}"',
                    Kind.CONTRADICTION if complete else Kind.SHORT,
                )


@check("told otherwise: rates", "by its pose, turned and renamed it has the same rates")
def same_rates(evidence, notes):
    """Compare the rates of R pairs, in size, in the rows of both."""
    other = told_otherwise(evidence)
    if other is None:
        return
    bare = replace(evidence.tracer.mechanism, masses=(), loads=(), stops=(), outputs=())
    tables = [_rates(each) for each in (bare, other)]
    for key, (cosines, rates, dq) in tables[0].items():
        for row in range(len(cosines)):
            if key not in tables[1]:
                continue
            others, theirs, their_dq = tables[1][key]
            if not len(others):
                continue
            # Modes may look alike where they are about to meet: any of them may be meant.
            alike = np.max(np.abs(others - cosines[row]), axis=1) < SAME
            if not np.any(alike):
                continue
            for what, mine, yours in (
                ("velocity_coefficient", rates, theirs),
                ("acceleration_coefficient", dq, their_dq),
            ):
                size = max(
                    1.0,
                    float(np.nanmax(rates[row], initial=0.0)) ** 2,
                    float(np.nanmax(np.abs(mine[row]), initial=0.0)),
                )
                off = np.abs(mine[row] - yours[alike]) / size
                if not np.any(np.isfinite(off)):
                    continue
                least = float(np.min(np.max(np.nan_to_num(off), axis=1)))
                notes.contradiction(
                    not least < AGREE,
                    f"input {key[1]} moves, sample {key[0]}: a {what} is "
                    f"{mine[row].round(9).tolist()} and, told otherwise, "
                    f"{yours[alike].round(9).tolist()}",
                )


def _rates(made):
    """Return by sample and moved input what rows are, and both coefficients of R pairs."""
    tracer = Tracer(made, samples=SAMPLES)
    motion = tracer.motion()
    run = sk.run(made, "poles", samples=SAMPLES)
    poles = run.frame("poles")
    names = sorted(pair.name for pair in made.pairs if pair.type == "R")
    ends = {pair.name: set(pair.links) for pair in made.pairs}
    columns = {}
    together = [
        frozenset(pair)
        for pair in zip(
            poles["link"].astype(str), poles["relative_to"].astype(str), strict=True
        )
    ]
    poles = poles.assign(both=pd.Series(together, index=poles.index))
    for name in names:
        rows = poles[poles["both"] == frozenset(ends[name])]
        columns[name] = rows.set_index(["sample", "assembly_mode", "moving"])[
            ["velocity_coefficient", "acceleration_coefficient", "status"]
        ]
    found: dict[tuple[int, str], tuple[Floats, Floats, Floats]] = {}
    for sample in range(1, SAMPLES - 1):
        fine = (motion.sample == sample) & (motion.status == Status.OK)
        fine &= motion.conditioning < CLEAR
        cosines = _angles(motion, sample)
        for item in made.inputs:
            rates = [
                [
                    _at(columns[name], (sample, int(assembly_mode), item.pair))
                    for name in names
                ]
                for assembly_mode in motion.assembly_mode[fine]
            ]
            both = np.array(rates, dtype=float).reshape(-1, len(names), 2)
            found[sample, item.pair] = cosines, both[..., 0], both[..., 1]
    return found


def _at(rows, key):  # type: ignore[no-untyped-def]
    if key not in rows.index:
        return np.nan, np.nan
    row = rows.loc[key]
    if str(row["status"]) != "OK":
        return np.nan, np.nan
    # A pole's axis has a sense of its own: its rate has a size, and rate *
    # acceleration_coefficient a value, that do not depend on it.
    rate, change = (
        float(row["velocity_coefficient"]),
        float(row["acceleration_coefficient"]),
    )
    return abs(rate), change * np.sign(rate) if abs(rate) > STILL else abs(change)
