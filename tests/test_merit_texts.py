"""Texts of figures of merit: their names, inputs and units."""

import numpy as np
import pytest

import spherekit as sk
from spherekit.errors import AnalysisError, DesignError
from spherekit.runs.figure_of_merit import parse_merit

VARY = {"links.2.arc": "10:30:2"}


def test_two_figures_of_one_default_name_are_refused():
    texts = ["max(theta_41-theta_21)", "max(theta_41+theta_21)"]
    with pytest.raises(DesignError, match='both be called "max_theta_41_theta_21"'):
        sk.sweep("four_bar", VARY, texts, samples=5)
    # The same figure twice is one column.
    frame = sk.sweep("four_bar", VARY, [texts[0], texts[0]], samples=5).frame()
    assert list(frame.columns).count("max_theta_41_theta_21") == 1


@pytest.mark.parametrize("number", ["nan", "inf", "-1e400"])
def test_an_input_of_a_figure_is_finite(number):
    with pytest.raises(AnalysisError, match="needs a finite input value Q"):
        parse_merit(f"at(theta_41, {number})", "deg")


def test_the_pair_of_a_single_input_does_not_change_the_unit():
    texts = ["a=argmin(theta_41)", "b=argmin(theta_41, 21)"]
    frame = sk.sweep("four_bar", VARY, texts, samples=12).frame()
    assert np.array_equal(frame["a"], frame["b"])


def test_a_figure_of_a_table_names_a_driven_pair():
    text = "argmin(poles.poles: velocity_coefficient, 99)"
    with pytest.raises(DesignError, match="driven pair, found 99. Driven pairs: 21"):
        sk.sweep("four_bar", VARY, text, samples=5)
