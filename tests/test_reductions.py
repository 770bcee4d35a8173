"""Reductions of the values at samples to one figure of merit."""

import numpy as np
import pytest

import spherekit as sk
from spherekit.cli.main import main
from spherekit.runs.reductions import REDUCTION_BY_NAME, reduce_samples, sample_weights

Q = np.linspace(0.0, 1.0, 7)
"""Inputs (rad) of the samples; they do not return to their start."""

VALUES = np.array([0.3, 0.9, np.nan, -0.4, 0.2, 0.7, 0.1])
"""Values at the samples. At the third sample the mechanism cannot be assembled."""

DIFFERENTIABLE = [
    name for name, reduction in REDUCTION_BY_NAME.items() if not reduction.returns_input
]


def reduce(name, values):
    """Return the number that a reduction gives for the values (7,) of one mode."""
    if REDUCTION_BY_NAME[name].needs_point:
        values = values[-1:]
    return reduce_samples(name, Q[-len(values) :], values[:, None]).item()


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("min", -0.4),
        ("max", 0.9),
        ("mean", 1.8 / 6),
        ("rms", np.sqrt((0.09 + 0.81 + 0.16 + 0.04 + 0.49 + 0.01) / 6)),
        ("range", 1.3),
        # The sample without a value divides the path: 0.3 to 0.9 and -0.4 to 0.7.
        ("swing", 1.1),
        ("sum", 1.8),
        ("argmin", 3 / 6),
        ("argmax", 1 / 6),
        ("at", 0.1),
    ],
)
def test_a_reduction_gives_the_number_found_by_hand(name, expected):
    assert reduce(name, VALUES) == pytest.approx(expected, abs=1e-15)


@pytest.mark.parametrize("name", DIFFERENTIABLE)
def test_derivatives_by_the_values_are_central_differences(name):
    """Each value is changed by 1e-6; the error of the differences is below 1e-9."""
    figure = reduce(name, VALUES)
    values = VALUES[-1:] if REDUCTION_BY_NAME[name].needs_point else VALUES
    weights = sample_weights(name, values, figure, is_closed_path=False)
    for sample in np.flatnonzero(np.isfinite(values)):
        change = np.zeros(len(VALUES))
        change[len(VALUES) - len(values) + sample] = 1e-6
        difference = reduce(name, VALUES + change) - reduce(name, VALUES - change)
        assert weights[sample] == pytest.approx(difference / 2e-6, abs=1e-9)
    assert not np.any(weights[np.isnan(values)])


@pytest.mark.parametrize("name", REDUCTION_BY_NAME)
def test_no_value_at_all_gives_nan(name):
    assert np.isnan(reduce(name, np.full(7, np.nan)))


@pytest.mark.parametrize("name", ["max", "mean", "rms", "range", "sum"])
def test_an_infinite_value_makes_the_number_infinite(name):
    assert reduce(name, np.append(VALUES[:-1], np.inf)) == np.inf


@pytest.mark.parametrize(("name", "value"), [("argmin", np.inf), ("argmax", -np.inf)])
def test_a_single_infinite_value_has_its_input(name, value):
    values = np.full(7, np.nan)
    values[4] = value
    assert reduce(name, values) == Q[4]


@pytest.mark.slow
def test_a_mean_of_a_sweep_includes_infinite_values():
    """1/q is infinite at the first of the samples 0, pi/2, pi, 3 pi/2, 2 pi."""
    figures = ["mean=mean(1/q)", "inverse=mean(1/(q+1))"]
    rows = sk.sweep("four_bar", {"links.2.arc": [20.0]}, figures, samples=5).frame()
    expected = np.mean(1 / (np.arange(5) * np.pi / 2 + 1))
    assert np.all(rows["mean"] == np.inf)
    assert np.allclose(rows["inverse"], expected, rtol=1e-12)


def test_the_help_of_sweep_lists_every_reduction(capsys):
    with pytest.raises(SystemExit):
        main(["sweep", "--help"])
    help_text = " ".join(capsys.readouterr().out.split())
    listed = help_text.partition("that a reduction (")[2].partition(")")[0]
    assert set(listed.split(", ")) == set(REDUCTION_BY_NAME)
