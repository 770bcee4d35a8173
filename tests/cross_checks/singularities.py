"""Singularities against poles, motions and the velocity equations."""

from typing import Any

import numpy as np
from cross_checks.assembly_modes import place_of
from cross_checks.evidence import Kind, check

from spherekit.completeness import Guarantee
from spherekit.positions.assembly_enumeration import enumerate_assemblies
from spherekit.positions.input_revolutions import whole_periods

SINGULAR = 1e5
"""Least conditioning of the locked mechanism at a place that is said to be singular."""
NEAR = 1e-7
"""Distance (rad) in the inputs of a place at which the mechanism is nearly singular."""
NEARLY = 30.0
"""Least conditioning there."""
AGREE = 1e-6
MOST = 8
"""How many places of a mechanism are put in as inputs."""
LEADS = 1e-5
"""By how much (rad) a stated distance may miss a place."""


def listed(evidence, notes):
    """Return the tables of singularities by their default command, if there are any."""
    ran = evidence.ran("singularities")
    if ran.status:
        return None
    return ran.tables


INPUT_RESTS = ("II", "III", "self-motion")
"""Kinds of places at which links can move though the inputs are locked."""


@check("places are singular", "where a locked input lets links move, rank is lost")
def places_are_singular(evidence, notes):
    """Look at the conditioning of the mechanism with its inputs locked."""
    tables = listed(evidence, notes)
    if tables is None:
        return
    points = tables["singularities"]
    points = points[points["kind"].isin(INPUT_RESTS)]
    if evidence.single:
        _on_curves(evidence, points, notes)
    else:
        _at_inputs(evidence, points, notes)


def _on_curves(evidence, points, notes):
    curves, tracer = evidence.configurations.curves, evidence.tracer
    points = points[points["s"].notna() & (points["certain"] == "yes")]
    row: Any
    for row in points.head(MOST).itertuples():
        values = curves[row.curve].curve.at(row.s).values.reshape(1, -1)
        worst = float(tracer.given(values).conditioning[0])
        notes.contradiction(
            not worst > SINGULAR,
            f"{row.kind} of {row.output} at q = {np.degrees(row.q):.9g} deg (curve "
            f"{row.curve}, s = {row.s:.9g}): the locked mechanism has the conditioning "
            f"{worst:.3g} there",
        )
        if row.kind == "III":
            continue  # where curves cross they end a little before
        off = abs(values[0, tracer.solver.input_variable] - row.q)
        off = abs(off - 2.0 * np.pi * round(off / (2.0 * np.pi)))
        notes.contradiction(
            not off < AGREE,
            f"{row.kind} of {row.output}: the curve is at {off:.2e} rad from q = "
            f"{row.q:.9g}",
        )


def _at_inputs(evidence, points, notes):
    """Look at all configurations at inputs beside the place, where two of them meet."""
    tracer = evidence.tracer
    names = [f"q_{name}" for name in tracer.inputs]
    places = points[names].to_numpy(dtype=float)
    chosen = evidence.random.permutation(len(places))[:MOST]
    for place in places[chosen]:
        worst = 0.0
        for direction in np.concatenate([np.eye(len(names)), -np.eye(len(names))]):
            values = enumerate_assemblies(tracer.solver, place + NEAR * direction).values
            if len(values):
                worst = max(worst, float(np.nanmax(tracer.given(values).conditioning)))
        notes.contradiction(
            0.0 < worst < NEARLY,
            f"type II or III at {place_of(place)}: {NEAR:g} rad beside it the worst "
            f"conditioning of all modes is {worst:.3g}",
        )


@check(
    "assembly modes end at places",
    "where an assembly mode goes out of reach a type II is listed",
)
def assembly_modes_end_at_places(evidence, notes):
    """Compare samples between which an assembly mode ends with the places listed."""
    tables = listed(evidence, notes) if evidence.single else None
    if tables is None:
        return
    points, motion = tables["singularities"], tables["motion"]
    kinds = points["kind"]
    sampled = evidence.configurations.guarantee is Guarantee.SAMPLED
    whole = points["s"].isna() & points["q"].isna()
    ends = kinds.isin(INPUT_RESTS)
    for assembly_mode, rows in motion.groupby("assembly_mode"):
        q, status = rows["q"].to_numpy(), rows["status"].to_numpy()
        held = status == "OK"
        lost = status == "OUT_OF_REACH"
        for k in range(len(q) - 1):
            if not ((held[k] and lost[k + 1]) or (lost[k] and held[k + 1])):
                continue
            low, high = sorted((q[k], q[k + 1]))
            own = (
                points["assembly_mode"]
                .map(lambda text, b=assembly_mode: _among(b, text))
                .to_numpy(bool)
            )
            at = both_ends(evidence, points.loc[ends & own, "q"].to_numpy(dtype=float))
            inside = (at >= low - AGREE) & (at <= high + AGREE)
            notes.judged()
            if not (inside.any() or (ends & own & whole).any()):
                notes.found(
                    f"assembly mode {assembly_mode} ends between q = "
                    f"{np.degrees(low):.6f} and "
                    f"{np.degrees(high):.6f} deg, and no type II or III of it is listed",
                    Kind.SHORT if sampled else Kind.CONTRADICTION,
                )


def both_ends(evidence, at):
    """Return places (n,), those at one end of a range of whole turns at its other end too.

    They are listed once.
    """
    (item,) = evidence.tracer.mechanism.inputs
    low, high = sorted((item.start, item.stop))
    (period,) = evidence.tracer.solver.periods
    if not whole_periods(low, high, period):
        return at
    more = np.concatenate([at, at + (high - low), at - (high - low)])
    return more[(more >= low - LEADS) & (more <= high + LEADS)]


def _among(assembly_mode, text):
    return str(assembly_mode) in str(text).replace(",", " ").replace("+", " ").split()


@check("singular rows are listed", "where rows are AT_SINGULARITY a place is listed")
def singular_rows_are_listed(evidence, notes):
    """Compare rows at a singularity with the places listed."""
    tables = listed(evidence, notes)
    if tables is None:
        return
    points, motion = tables["singularities"], tables["motion"]
    rows = motion[motion["status"] == "AT_SINGULARITY"]
    if not len(rows):
        return
    ran = evidence.ran("singularities")
    everywhere = "everywhere" in ran.said or "in every configuration" in ran.said
    names = ["q"] if evidence.single else [f"q_{name}" for name in evidence.tracer.inputs]
    if not evidence.single and not len(points):
        return  # no curves were asked for
    places = points[names].to_numpy(dtype=float)
    if evidence.single:
        places = both_ends(evidence, places[:, 0])[:, None]
    whole = bool(evidence.single and points["s"].isna().any())
    for q in rows[names].to_numpy()[:MOST]:
        gap = np.min(np.max(np.abs(places - q), axis=1), initial=np.inf)
        notes.contradiction(
            evidence.single and not (gap < 1e-3 or whole or everywhere),
            f"a row at {place_of(q)} is AT_SINGULARITY, the nearest place listed is "
            f"{gap:.2e} rad off",
        )
