"""Singularities against poles, motions and the velocity equations."""

from typing import Any

import numpy as np
from sceptic.evidence import Kind, check
from sceptic.modes import place_of

import spherekit as sk
from spherekit.guarantee import Guarantee
from spherekit.motion.elimination import assemblies
from spherekit.motion.turns import whole_periods

SINGULAR = 1e5
"""Least conditioning of the locked mechanism at a place that is said to be singular."""
NEAR = 1e-7
"""Distance (rad) in the inputs of a place at which the mechanism is nearly singular."""
NEARLY = 30.0
"""Least conditioning there."""
CLEAR = 1e-3
"""Least singular value at rows whose rates are compared."""
AGREE = 1e-6
MOST = 8
"""How many places of a mechanism are put in as inputs."""
LEADS = 1e-5
"""By how much (rad) a stated distance may miss a place."""
STILL = 1e-9
"""Rates below this have no sign."""
FINER = 24
"""Parts of a step of samples in which signs are looked at once more."""


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
    points = points[points["kind"].astype(str).isin(INPUT_RESTS)]
    if evidence.single:
        _on_curves(evidence, points, notes)
    else:
        _at_inputs(evidence, points, notes)


def _on_curves(evidence, points, notes):
    curves, tracer = evidence.configurations.curves, evidence.tracer
    points = points[points["s"].notna() & (points["certain"].astype(str) == "yes")]
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
        off = abs(values[0, tracer.solver.single] - row.q)
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
            here = assemblies(tracer.solver, place + NEAR * direction)
            values = np.array([found for _, found in here.modes])
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
    kinds = points["kind"].astype(str)
    sampled = evidence.configurations.guarantee is Guarantee.SAMPLED
    whole = points["s"].isna() & points["q"].isna()
    ends = kinds.isin(INPUT_RESTS)
    for assembly_mode, rows in motion.groupby("assembly_mode"):
        q, status = rows["q"].to_numpy(), rows["status"].astype(str).to_numpy()
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
    rows = motion[motion["status"].astype(str) == "AT_SINGULARITY"]
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


@check("relation and poles", "y'/q' of the relation is the rate of the output's pole")
def relation_and_poles(evidence, notes):
    """Compare sizes of rates, which have a sign of their own in each table."""
    tables = listed(evidence, notes)
    poles = evidence.ran("poles")
    if tables is None or poles.status:
        return
    relation = tables["singularities_relation"]
    frame = poles.tables["poles"]
    keys = ["sample", "assembly_mode", "moving"]
    relation = relation.assign(moving=relation["moving"].astype(str))
    frame = frame[frame["status"].astype(str).isin(("OK", "NO_POLE"))]
    for output in relation["output"].astype(str).unique():
        link, base = output.split("/")
        own = relation[
            (relation["output"].astype(str) == output)
            & (relation["status"].astype(str) == "OK")
            & (relation["sigma"] > CLEAR)
            & np.isfinite(relation["velocity_coefficient"].to_numpy(dtype=float))
        ]
        ends = frame["link"].astype(str) + "/" + frame["relative_to"].astype(str)
        there = frame[ends.isin((output, f"{base}/{link}"))]
        both = own.merge(
            there.assign(moving=there["moving"].astype(str)),
            on=keys,
            suffixes=("", "_pole"),
        )
        if not len(both):
            continue
        one = both["velocity_coefficient"].abs().to_numpy()
        other = both["velocity_coefficient_pole"].abs().to_numpy()
        off = np.abs(one - other) / np.maximum(1.0, other)
        notes.judged(len(both))
        if np.nanmax(off) > AGREE:
            k = int(np.nanargmax(off))
            row = both.iloc[k]
            notes.found(
                f"sample {row['sample']}, assembly mode {row['assembly_mode']}, "
                f"{row['moving']} moves: "
                f"the relation of {output} (form {row['form']}) has the rate {one[k]:.9g}, "
                f"the pole {other[k]:.9g}; {int(np.sum(off > AGREE))} such rows"
            )


@check("signs change at places", "rates of an output change sign at places of type I")
def signs_change_at_places(evidence, notes):
    """Compare signs at neighbouring samples with the places between them, by parity.

    Not across a crossing of curves: which of them an assembly mode goes on along is the
    choice of its dyads' signs, and another one than that of the curve that is smooth. Nor
    across two dead centres, between which it does not close.
    """
    tables = listed(evidence, notes) if evidence.single else None
    if tables is None:
        return
    poles = evidence.ran("poles")
    points = tables["singularities"]
    sampled = evidence.configurations.guarantee is Guarantee.SAMPLED
    frame = poles.tables["poles"]
    ends = frame["link"].astype(str) + "/" + frame["relative_to"].astype(str)
    outputs = tables["singularities_relation"]["output"].astype(str).unique()
    for output in outputs:
        link, base = output.split("/")
        there = frame[ends.isin((output, f"{base}/{link}"))]
        own = points[points["output"].astype(str).isin((output, "", "nan"))]
        turning = own["reversal"].astype(str).str.contains("output").to_numpy(bool)
        assembly_mode: Any
        for assembly_mode, rows in there.groupby("assembly_mode"):
            on_assembly_mode = (
                own["assembly_mode"]
                .map(lambda text, b=assembly_mode: _among(b, text))
                .to_numpy(bool)
            )
            at = np.sort(own.loc[turning & on_assembly_mode, "q"].to_numpy())
            crossed = own["note"].astype(str).str.contains("curves cross").to_numpy(bool)
            dead = own["reversal"].astype(str).str.contains("input").to_numpy(bool)
            crossings = own.loc[(crossed | dead) & on_assembly_mode, "q"].to_numpy()
            _parities(
                evidence, output, assembly_mode, rows, (at, crossings), sampled, notes
            )


def _parities(evidence, output, assembly_mode, rows, places, sampled, notes):
    at, crossings = places
    q = rows["q"].to_numpy()
    w = (
        rows[["ux", "uy", "uz"]].to_numpy()
        * rows["velocity_coefficient"].to_numpy()[:, None]
    )
    known = rows["status"].astype(str).to_numpy() == "OK"
    doubtful = 0
    for k in range(len(q) - 1):
        if not (known[k] and known[k + 1]):
            continue
        low, high = sorted((q[k], q[k + 1]))
        if np.any(np.abs(at - low) < AGREE) or np.any(np.abs(at - high) < AGREE):
            continue
        if np.any((crossings > low - AGREE) & (crossings < high + AGREE)):
            continue
        count = int(np.sum((at > low) & (at < high)))
        if min(np.linalg.norm(w[k]), np.linalg.norm(w[k + 1])) < STILL:
            continue
        turned = int(w[k] @ w[k + 1] < 0.0)
        notes.judged()
        if turned == count % 2 or doubtful > 3:
            continue
        doubtful += 1
        fine = _reversals(evidence, output, assembly_mode, q[k], q[k + 1])
        if fine is None or fine % 2 == count % 2:
            continue
        notes.found(
            f"assembly mode {assembly_mode}, q = {np.degrees(q[k]):.6f} to "
            f"{np.degrees(q[k + 1]):.6f} deg: the rate of {output} reverses {fine} times, "
            f"{count} reversals are listed",
            Kind.SHORT if sampled else Kind.CONTRADICTION,
        )


def _reversals(evidence, output, assembly_mode, first, last):
    """Return how often the angular velocity of an output reverses between inputs.

    None where it swings round too fast to tell.
    """
    q = np.linspace(first, last, FINER + 1)
    link, base = output.split("/")
    motion = evidence.tracer.at(q[:, None])
    rows = motion.values[motion.assembly_mode == assembly_mode]
    if not np.all(np.isfinite(rows)):
        return None
    run = sk.run(evidence.mechanism, f"poles:only={link}/{base}", path=q[:, None])
    frames = run.frame("motion")
    names = [f"theta_{p.name}" for p in evidence.mechanism.pairs if p.type == "R"]
    wanted = rows[FINER // 2][
        [evidence.mechanism.variable_names.index(name) for name in names]
    ]
    middle = frames[frames["sample"] == FINER // 2]
    gap = np.max(
        np.abs(np.exp(1j * middle[names].to_numpy()) - np.exp(1j * wanted)), axis=1
    )
    if not len(gap) or not np.nanmin(gap) < 1e-6:
        return None
    number = middle["assembly_mode"].to_numpy()[int(np.nanargmin(gap))]
    found = run.frame("poles")
    found = found[found["assembly_mode"] == number]
    w = (
        found[["ux", "uy", "uz"]].to_numpy()
        * found["velocity_coefficient"].to_numpy()[:, None]
    )
    size = np.linalg.norm(w, axis=1)
    cosine = np.sum(w[1:] * w[:-1], axis=1) / (size[1:] * size[:-1])
    if not (np.all(np.abs(cosine) > 0.7) and np.all(size > STILL)):
        return None
    return int(np.sum(cosine < 0.0))


@check("distances lead to places", "an input moved by to_I or to_II is at a place")
def distances_lead_to_places(evidence, notes):
    """Compare q +- to_II with the inputs of the places listed, and q +- to_I.

    Of distances to type I those are looked at on whose way the input does not turn.
    """
    tables = listed(evidence, notes) if evidence.single else None
    if tables is None:
        return
    points, relation = tables["singularities"], tables["singularities_relation"]
    (item,) = evidence.tracer.mechanism.inputs
    low, high = sorted((item.start, item.stop))
    kinds = points["kind"].astype(str)
    q = relation["q"].to_numpy()
    to_two = np.nan_to_num(relation["input_margin_II"].to_numpy(dtype=float), nan=np.inf)
    for kind in ("I", "II"):
        own = kinds.isin((kind, "III")).to_numpy(bool)
        at = both_ends(evidence, points.loc[own, "q"].dropna().to_numpy())
        to = relation[f"input_margin_{kind}"].to_numpy(dtype=float)
        inside = np.isfinite(to) & (q - np.abs(to) > low) & (q + np.abs(to) < high)
        if kind == "I":
            inside &= np.abs(to) < np.abs(to_two)
        rows = np.flatnonzero(inside)
        notes.judged(len(rows))
        if not len(rows):
            continue
        gap = np.full(len(rows), np.inf)
        for sign in (1.0, -1.0):
            there = (q + sign * to)[rows]
            off = np.min(np.abs(there[:, None] - at[None]), axis=1, initial=np.inf)
            gap = np.minimum(gap, off)
        if np.max(gap) > LEADS:
            row = relation.iloc[rows[int(np.argmax(gap))]]
            notes.found(
                f"sample {row['sample']}, assembly mode {row['assembly_mode']}: "
                f"input_margin_{kind} = {row[f'input_margin_{kind}']:.9g} of "
                f"{row['output']} leads from q = {row['q']:.9g} rad to no place of type "
                f"{kind} or III (the nearest {np.max(gap):.2e} rad off); "
                f"{int(np.sum(gap > LEADS))} such rows"
            )
