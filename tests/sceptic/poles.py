"""Pole axes and rates against differences of what they are the derivatives of."""

import re

import numpy as np
from sceptic.evidence import Kind, check

import spherekit as sk
from spherekit.errors import SolveError
from spherekit.numeric.crossings import wrap

STEP = 1e-3
"""Distance (rad) of inputs from which derivatives are taken."""
PLACES = 3
LEAST = 1e-6
"""Deviation, relative to the largest of what is compared, that is right at any rate."""
SPREAD = 30.0
"""How many times as far from a difference as differences of two steps are apart."""
WEIGHTS = np.array([1.0, -8.0, 0.0, 8.0, -1.0]) / 12.0


def slopes(values):
    """Return derivatives (...) from values (9, ...) at -4 to 4 steps, and their doubt."""
    fine = np.tensordot(WEIGHTS, values[2:7], 1) / STEP
    coarse = np.tensordot(WEIGHTS, values[::2], 1) / (2.0 * STEP)
    return fine, np.abs(fine - coarse)


def around(evidence, analysis):
    """Return runs of an analysis over nine inputs close together, at some samples.

    With several inputs one moves, named first.
    """
    inputs = evidence.mechanism.inputs
    runs = []
    for k in range(PLACES):
        moved = k % len(inputs)
        q = [
            item.start + evidence.random.random() * (item.stop - item.start)
            for item in inputs
        ]
        path = np.tile(np.array(q), (9, 1))
        path[:, moved] += STEP * np.arange(-4, 5)
        try:
            run = sk.run(evidence.mechanism, analysis, path=path)
        except SolveError:
            continue  # it does not close there
        runs.append((inputs[moved].pair, run))
    return runs


@check("poles and pairs", "rates of poles are derivatives of the pair variables")
def poles_and_pairs(evidence, notes):
    """Compare the rate of each R pair's pole with the slope of the pair's variable."""
    for moved, run in around(evidence, "poles"):
        motion, poles = run.frame("motion"), run.frame("poles")
        poles = poles[poles["moving"].astype(str) == moved]
        for assembly_mode in motion["assembly_mode"].unique():
            rows = motion[motion["assembly_mode"] == assembly_mode]
            if not (rows["status"] == "OK").all() or len(rows) != 9:
                continue
            own = poles[(poles["assembly_mode"] == assembly_mode) & (poles["sample"] == 4)]
            q = rows.filter(regex=rf"^q(_{re.escape(moved)})?$").iloc[4, 0]
            for pair in evidence.mechanism.pairs:
                if pair.type != "R":
                    continue
                theta = rows[f"theta_{pair.name}"].to_numpy()
                slope, doubt = slopes(theta[4] + wrap(theta - theta[4]))
                at = own[
                    own["link"].astype(str).isin(pair.links)
                    & own["relative_to"].astype(str).isin(pair.links)
                ]
                if len(at) != 1 or str(at["status"].iloc[0]) not in ("OK", "NO_POLE"):
                    continue
                rate = abs(float(at["velocity_coefficient"].iloc[0]))
                off = abs(rate - abs(float(slope)))
                off -= float(at["velocity_coefficient_error_bound"].iloc[0])
                notes.contradiction(
                    not off <= LEAST * max(1.0, rate) + SPREAD * float(doubt),
                    f"{moved} moves, assembly mode {assembly_mode}, q = "
                    f"{q:.9f} rad: "
                    f"the rate of "
                    f"{pair.name} is {rate:.9g}, its variable changes by "
                    f"{abs(float(slope)):.9g}",
                )


@check(
    "rates and derivatives",
    "acceleration_coefficient is the derivative of rate along the pole",
)
def rates_and_derivatives(evidence, notes):
    """Compare acceleration_coefficient with the slope of rate * u along u."""
    for moved, run in around(evidence, "poles"):
        poles = run.frame("poles")
        poles = poles[poles["moving"].astype(str) == moved]
        for (assembly_mode, link, base), rows in poles.groupby(
            ["assembly_mode", "link", "relative_to"], observed=True
        ):
            if len(rows) != 9 or not (rows["status"] == "OK").all():
                continue
            w = _vectors(rows)
            change, doubt = slopes(w)
            u = rows[["ux", "uy", "uz"]].to_numpy()[4]
            given = float(rows["acceleration_coefficient"].iloc[4])
            slope = float(change @ u)
            scale = max(1.0, float(np.max(np.abs(w))) ** 2, float(np.max(np.abs(change))))
            # What is stated of the coefficient, and of the rates that the slope is of.
            stated = float(rows["acceleration_coefficient_error_bound"].iloc[4])
            stated += float(rows["velocity_coefficient_error_bound"].max()) / STEP
            off = abs(given - slope) - stated
            notes.contradiction(
                not off <= LEAST * scale + SPREAD * float(np.max(doubt)),
                f"{moved} moves, assembly mode {assembly_mode}, q = "
                f"{rows['q'].iloc[4]:.9f} rad: "
                f"acceleration_coefficient of "
                f"{link} to {base} is {given:.9g}, rate changes by {slope:.9g}",
            )


def _vectors(rows):
    """Return rate * u (n, 3)."""
    u = rows[["ux", "uy", "uz"]].to_numpy()
    return np.asarray(u * rows["velocity_coefficient"].to_numpy()[:, None])


@check("inertia and derivative", "dB_dq is the derivative of the equivalent inertia B")
def inertia_and_derivative(evidence, notes):
    """Compare dB_dq with the slope of B."""
    if not evidence.single or not (evidence.mechanism.masses or evidence.mechanism.loads):
        return
    for _, run in around(evidence, "eksergian"):
        frame = run.frame("eksergian")
        for assembly_mode, rows in frame.groupby("assembly_mode"):
            if len(rows) != 9 or not (rows["status"] == "OK").all():
                continue
            slope, doubt = slopes(rows["B"].to_numpy())
            given = float(rows["dB_dq"].iloc[4])
            scale = max(float(rows["B"].abs().max()), abs(given), 1e-12)
            notes.contradiction(
                not abs(given - slope) <= LEAST * scale + SPREAD * float(doubt),
                f"assembly mode {assembly_mode}, q = {rows['q'].iloc[4]:.9f} rad: dB_dq is "
                f"{given:.9g}, B "
                f"changes by {float(slope):.9g}",
            )


@check("verify", "the 50 digits of --verify confirm what rows state of their errors")
def verify(evidence, notes):
    """Ask for a few rows in 50 digits."""
    ran = evidence.ran("poles", "--verify", "6", "--samples", "25")
    if ran.status:
        return
    found = ran.summary.get("verified")
    if not found:
        notes.found(f"nothing was verified: {ran.err.strip()[-120:]}", Kind.SILENT)
        return
    directions = found.get("directions") or {}
    notes.judged(directions.get("count", 0))
    if directions.get("over_bound", 0.0) > 1.0:
        notes.found(
            f"a direction is off by {directions['error_rad']:.2e} rad, "
            f"{directions['over_bound']:.3g} times its bound, at sample "
            f"{directions['sample']}, assembly mode {directions['assembly_mode']}, "
            f"{directions['subject']}"
        )
