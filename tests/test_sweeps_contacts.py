"""Sweeps of wheels and of sliding circles against separate runs of each design."""

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
"""Text of the file (None: shipped), varied numbers, a passive pair, two inputs (deg)."""

SLOW = (pytest.mark.slow,)


def write_mechanism(folder, text):
    path = folder / "mechanism.toml"
    path.write_text(text)
    return path


@pytest.mark.slow
@pytest.mark.many
@pytest.mark.parametrize(
    "case", [pytest.param(case, marks=SLOW if case == "geared" else ()) for case in CASES]
)
def test_a_sweep_of_wheels_or_contacts_has_the_figures_of_separate_runs(case, tmp_path):
    """A sweep over designs by the compiled kernel has the numbers of separate runs.

    Compared are sine, cosine and rate of a passive pair at two inputs, for all modes (ways
    to assemble the links). The modes may differ in order, so rows are sorted. A design
    whose loops do not close is not OK in the sweep, and a run refuses it. In mechanisms
    with several inputs, rates are those while the input `right` moves alone. `CASES` has
    the mechanisms.
    """
    text, vary, pair, inputs_deg = CASES[case]
    mechanism = write_mechanism(tmp_path, text) if text else case
    has_several_inputs = isinstance(inputs_deg[0], tuple)
    rate = f"rate_{pair}_by_right" if has_several_inputs else f"rate_{pair}"
    columns = {"sine": f"sin(theta_{pair})", "cosine": f"cos(theta_{pair})", "rate": rate}
    figures = []
    for k, input_deg in enumerate(inputs_deg):
        input_text = ", ".join(map(str, np.atleast_1d(input_deg)))
        for name, column in columns.items():
            figures.append(f"{name}_{k}=at({column}, {input_text})")
    result = sk.sweep(mechanism, vary, figures, samples=9)
    # Without a kernel the sweep would itself make separate runs.
    assert result.sweep.evaluator.kernel is not None
    frame = result.frame()
    # `claim` says how complete the modes of a design are; it may be empty without modes.
    assert set(frame["claim"]) <= {"complete", ""}

    for _, rows in frame.groupby("design"):
        # Columns have the keys of the varied numbers, with underscores in place of points.
        numbers = {key: rows[key.replace(".", "_")].iloc[0] for key in vary}
        if rows["status"].iloc[0] != "OK":
            with pytest.raises(sk.SpherekitError):
                sk.trace(with_file_numbers(mechanism, numbers), samples=9)
            continue
        run = sk.evaluate(with_file_numbers(mechanism, numbers), np.radians(inputs_deg))
        theta = run.variable(pair)
        rates = run.variable_coefficient(pair, "right" if has_several_inputs else None)
        run_columns = np.array([np.sin(theta), np.cos(theta), rates]).T
        for k in range(len(inputs_deg)):
            # The run has a row for each mode and input; the input changes fastest.
            is_input_k = np.arange(len(theta)) % len(inputs_deg) == k
            expected = run_columns[is_input_k & (run.status == 0)]
            swept = rows[[f"{name}_{k}" for name in columns]].to_numpy()
            swept = swept[np.isfinite(swept[:, 0])]
            assert len(swept) == len(expected) > 0
            # Sorted by rounded numbers, so that rounding errors do not change the order
            swept = swept[np.lexsort(np.round(swept.T, 6))]
            expected = expected[np.lexsort(np.round(expected.T, 6))]
            assert swept == pytest.approx(expected, rel=1e-12, abs=1e-12)


@pytest.mark.slow
def test_sensitivities_of_wheels_are_the_same_by_contacts_and_by_ratios(tmp_path):
    """Two formulations of wheels in mesh give the same values and derivatives.

    `Sensitivity` computes derivatives by the sizes in a list. If no radius of a wheel is in
    the list, the angles of the wheels are related by the ratio of their teeth. With a
    radius in the list, this ratio would change. So wheels are then contacts of circles.
    Values, and derivatives by the three common sizes, must agree.
    """
    wheels = sk.load(write_mechanism(tmp_path, WHEELS))
    motion = sk.trace(wheels, samples=5)
    # Input, its rate 1, its acceleration 0 and the time 0.
    zeros = np.zeros_like(motion.q)
    ones = np.ones_like(motion.q)
    samples = np.stack([motion.q, ones, zeros, zeros], axis=1)
    sizes = ("links.1.angles.c", "links.1.arcs.c", "links.5.arc")
    quantities = ("theta_c", "theta_56", "rate_56")
    by_ratios = Sensitivity(wheels, sizes, quantities)
    values_by_ratios, gradients_by_ratios = by_ratios.at(samples, motion.values)
    by_contacts = Sensitivity(wheels, (*sizes, "pairs.m1.profiles.2.radius"), quantities)
    values, gradients = by_contacts.at(samples, motion.values)
    # Angles may differ by whole turns, which their sines do not show.
    assert np.sin(values) == pytest.approx(np.sin(values_by_ratios), abs=1e-11)
    # The first axis is the size.
    assert gradients[:3] == pytest.approx(gradients_by_ratios, abs=1e-9)
    assert np.max(np.abs(gradients[3])) > 0.1


@pytest.mark.slow
def test_a_differential_has_derivatives_although_its_equations_repeat(tmp_path):
    """The derivative by one size agrees with a central difference of scattered values."""
    mechanism = sk.load(write_mechanism(tmp_path, DIFFERENTIAL))
    motion = sk.trace(mechanism, samples=(2, 2))
    motion = motion.rows(np.flatnonzero(~motion.failed))
    sensitivity = Sensitivity(mechanism, ["pairs.knee.latitude"], ["theta_foot"])
    samples = sensitivity.at_rest(motion.inputs)
    _, gradients = sensitivity.at(samples, motion.values)
    step = 1e-4
    scattered = sensitivity.scattered(samples, motion.values, np.array([[step, -step]]))
    differences = (scattered[0, :, 0] - scattered[0, :, 1]) / (2.0 * step)
    assert gradients[0, 0] == pytest.approx(differences, abs=1e-6)


@pytest.mark.slow
def test_gradients_of_figures_on_wheels_agree_with_differences(tmp_path):
    """The gradient of a figure of merit agrees with central differences of its values.

    Synthesis uses such gradients. The mechanism has wheels in mesh. The figure is the rate
    of pair 56 at the input 100 deg, in the assembly mode "+". It is a rate, because an
    angle of a wheel could differ by whole turns between two designs. The gradient is by two
    arcs, per degree.
    """
    nominal = {"links.1.arcs.c": [70.0], "links.1.arcs.b": [50.0]}
    figure = "there=at(rate_56, 100)"
    result = sk.sweep(write_mechanism(tmp_path, WHEELS), nominal, figure, samples=5)
    figure_gradients = FigureGradients(result.sweep.evaluator)
    design = np.array([70.0, 50.0])
    mode = SynthesisMode("+")
    gradients = figure_gradients.evaluate(design, mode).gradients
    step = 1e-3  # deg
    for k, change in enumerate(step * np.eye(2)):
        above = figure_gradients.evaluate(design + change, mode).figures
        below = figure_gradients.evaluate(design - change, mode).figures
        derivative = (above - below) / (2.0 * step)
        assert gradients[:, k] == pytest.approx(derivative, rel=1e-6, abs=1e-9)
