"""Sweeps of wheels and of circles that slide against runs of each design."""

import numpy as np
import pytest
from helpers.refusals import mechanism_text
from mechanism_examples.shipped_mechanisms import with_file_numbers

import spherekit as sk
from spherekit.designs.figure_gradients import FigureGradients
from spherekit.designs.sensitivity import Sensitivity
from spherekit.designs.synthesis_modes import SynthesisMode

WHEELS = mechanism_text("three_wheels")

DIFFERENTIAL = mechanism_text("differential_with_rocker")

# A platform on three legs of which one is driven by a wheel, or is a contact.
PLATFORM = mechanism_text("platform")
GEARED = PLATFORM.format(mechanism_text("sweeps_contacts_geared"))
PUSHED = PLATFORM.format(mechanism_text("sweeps_contacts_pushed"))

CASES = {
    "roller_cam": (
        None,
        {
            "pairs.contact.profiles.cam.radius": [20.0],
            "pairs.contact.follower.roller": [12.0],
            "links.frame.arc": [60.0, 12.0],
        },
        "follower_pivot",
        [150.0, 180.0],
    ),
    "flat_cam": (
        None,
        {"pairs.contact.follower.pole_lonlat.1": [-50.0, -40.0]},
        "follower_pivot",
        [150.0, 180.0],
    ),
    "rolling_cones": (None, {"links.arm.arc": [70.0, 65.0]}, "roller_axis", [10.0, 500.0]),
    "wheels": (
        WHEELS,
        {"links.5.arc": [66.0], "pairs.m1.teeth.1": [23.0, 25.0]},
        "56",
        [10.0, 700.0],
    ),
    "differential": (
        DIFFERENTIAL,
        {"pairs.knee.latitude": [30.0, 35.0]},
        "knee",
        [(10.0, 20.0), (300.0, 70.0)],
    ),
    "geared": (GEARED, {"links.1.arcs.right": [74.0]}, "67", [90.0, 390.0]),
    "pushed": (PUSHED, {"pairs.push.profiles.7.radius": [30.0]}, "57", [5.0, 180.0]),
}

SLOW = (pytest.mark.slow,)


def written(folder, text):
    path = folder / "mechanism.toml"
    path.write_text(text)
    return path


@pytest.mark.slow
@pytest.mark.many
@pytest.mark.parametrize(
    "case", [pytest.param(case, marks=SLOW if case == "geared" else ()) for case in CASES]
)
def test_wheels_and_contacts_in_any_group_are_those_of_runs(case, tmp_path):
    text, vary, pair, places = CASES[case]
    mechanism = written(tmp_path, text) if text else case
    several = isinstance(places[0], tuple)
    rate = f"rate_{pair}" + ("_by_right" if several else "")
    columns = {"sine": f"sin(theta_{pair})", "cosine": f"cos(theta_{pair})", "rate": rate}
    reduce = [
        f"{name}_{k}=at({column}, {', '.join(map(str, np.atleast_1d(place)))})"
        for k, place in enumerate(places)
        for name, column in columns.items()
    ]
    found = sk.sweep(mechanism, vary, reduce, samples=9)
    assert found.sweep.evaluator.kernel is not None
    frame = found.frame()
    assert set(frame["claim"]) <= {"complete", ""}
    for _, rows in frame.groupby("design"):
        design = {key: rows[key.replace(".", "_")].iloc[0] for key in vary}
        if rows["status"].iloc[0] != "OK":
            with pytest.raises(sk.SpherekitError):
                sk.trace(with_file_numbers(mechanism, design), samples=9)
            continue
        run = sk.evaluate(with_file_numbers(mechanism, design), np.radians(places))
        theta = run.variable(pair)
        rates = run.variable_coefficient(pair, "right" if several else None)
        for k in range(len(places)):
            here = (np.arange(len(theta)) % len(places) == k) & (run.status == 0)
            wanted = np.array([np.sin(theta), np.cos(theta), rates]).T[here]
            mine = rows[[f"{name}_{k}" for name in columns]].to_numpy()
            mine = mine[np.isfinite(mine[:, 0])]
            assert len(mine) == len(wanted) > 0
            order = [np.lexsort(np.round(each.T, 6)) for each in (mine, wanted)]
            assert mine[order[0]] == pytest.approx(wanted[order[1]], rel=1e-12, abs=1e-12)


@pytest.mark.slow
def test_wheels_that_deviate_mesh_as_gears_do(tmp_path):
    """By the contacts as they are, and by ratios and offsets: two formulations."""
    wheels = sk.load(written(tmp_path, WHEELS))
    motion = sk.trace(wheels, samples=5)
    rest = np.zeros_like(motion.q)
    samples = np.stack([motion.q, rest + 1.0, rest, rest], axis=1)
    sizes = ("links.1.angles.c", "links.1.arcs.c", "links.5.arc")
    quantities = ("theta_c", "theta_56", "rate_56")
    given = Sensitivity(wheels, sizes, quantities).at(samples, motion.values)
    more = (*sizes, "pairs.m1.profiles.2.radius")
    ratios = Sensitivity(wheels, more, quantities).at(samples, motion.values)
    assert np.sin(ratios[0]) == pytest.approx(np.sin(given[0]), abs=1e-11)
    assert ratios[1][:3] == pytest.approx(given[1], abs=1e-9)
    assert np.max(np.abs(ratios[1][3])) > 0.1


def test_a_differential_has_derivatives_though_its_equations_repeat(tmp_path):
    made = sk.load(written(tmp_path, DIFFERENTIAL))
    motion = sk.trace(made, samples=(2, 2))
    motion = motion.rows(np.flatnonzero(~motion.failed))
    key = "pairs.knee.latitude"
    sensitivity = Sensitivity(made, [key], ["theta_foot"])
    samples = sensitivity.at_rest(motion.inputs)
    _, gradients = sensitivity.at(samples, motion.values)
    step = 1e-4
    drawn = sensitivity.scattered(samples, motion.values, np.array([[step, -step]]))
    slope = (drawn[0, :, 0] - drawn[0, :, 1]) / (2.0 * step)
    assert gradients[0, 0] == pytest.approx(slope, abs=1e-6)


@pytest.mark.slow
def test_gradients_of_figures_on_wheels_are_those_of_differences(tmp_path):
    """Whole turns with which wheels are put together are no change."""
    keys = {"links.1.arcs.c": [70.0], "links.1.arcs.b": [50.0]}
    merit = "there=at(rate_56, 100)"
    found = sk.sweep(written(tmp_path, WHEELS), keys, merit, samples=5)
    gradients = FigureGradients(found.sweep.evaluator)
    place, step = np.array([70.0, 50.0]), 1e-3
    mode = SynthesisMode("+")
    exact = gradients.evaluate(place, mode).gradients
    for k, change in enumerate(step * np.eye(2)):
        ends = [
            gradients.evaluate(place + sense * change, mode).figures
            for sense in (1.0, -1.0)
        ]
        slope = (ends[0] - ends[1]) / (2.0 * step)
        assert exact[:, k] == pytest.approx(slope, rel=1e-6, abs=1e-9)
