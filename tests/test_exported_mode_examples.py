"""The example of each assembly mode in exported formulas is one known configuration.

The mode values are those of the mode at the input of the example. Modes follow their smooth
curves through crossings, and some do not exist in the first interval between crossings.
"""

import numpy as np
import pytest
from mechanism_examples.flat_mechanisms import loaded

from spherekit.exchange.formula_maker import formulas

TWO_FOUR_BARS = """
format = 1
name = "series"
angle_unit = "deg"
ground = "s1"
[links]
s1 = { axes = ["c2", "c1", "e"], arcs = [40, 70], angles = [0] }
s2 = { axes = ["c1", "c4"], arcs = [60] }
s3 = { axes = ["c4", "c3"], arcs = [70] }
s4 = { axes = ["c2", "c3", "d1"], arcs = [60, 60], angles = [150] }
s5 = { axes = ["d1", "d2"], arcs = [30] }
s6 = { axes = ["d2", "e"], arcs = [40] }
[pairs]
c1 = { type = "R", links = ["s1", "s2"], zero = 0 }
c4 = { type = "R", links = ["s2", "s3"] }
c3 = { type = "R", links = ["s3", "s4"] }
c2 = { type = "R", links = ["s1", "s4"] }
d1 = { type = "R", links = ["s4", "s5"] }
d2 = { type = "R", links = ["s5", "s6"] }
e = { type = "R", links = ["s1", "s6"] }
[inputs.c1]
from = -60
to = 160
"""
"""Two four-bars in series. The second has a change point, at which two curves cross. Both
ways to assemble the first four-bar lead to it, at two inputs far from each other. The modes
that cross at the larger input do not exist below the smaller input."""

TRIAD_LINKS = """
[links.s7]
axes = ["g1", "g2", "g3"]
arcs = [50, 60]
angles = [70]
[links.s8]
axes = ["f1", "g1"]
arcs = [60]
[links.s9]
axes = ["f2", "g2"]
arcs = [65]
[links.s10]
axes = ["f3", "g3"]
arcs = [70]
[pairs]
f1 = { type = "R", links = ["s1", "s8"] }
f2 = { type = "R", links = ["s1", "s9"] }
f3 = { type = "R", links = ["s2", "s10"] }
g1 = { type = "R", links = ["s7", "s8"] }
g2 = { type = "R", links = ["s7", "s9"] }
g3 = { type = "R", links = ["s7", "s10"] }
"""
"""A triad, which has no closed form, and the pairs that join it to the links s1 and s2."""


def with_triad(text):
    """Return the text of the two four-bars with a triad between the links s1 and s2."""
    s1 = '"c1", "e"], arcs = [40, 70], angles = [0]'
    s1_of_triad = (
        '"c1", "e", "f1", "f2"], arcs = [40, 70, 100, 110], angles = [0, -60, -110]'
    )
    s2 = '"c4"], arcs = [60]'
    s2_of_triad = '"c4", "f3"], arcs = [60, 15], angles = [90]'
    text = text.replace(s1, s1_of_triad).replace(s2, s2_of_triad)
    return text.replace("[pairs]\n", TRIAD_LINKS)


def modes_without_first_interval(smooth):
    """Return the positions of modes without a configuration below the first crossing."""
    assert len(smooth.crossings) == 2
    (positions,) = np.nonzero(np.isnan(smooth.inputs[0]))
    assert len(positions)
    return positions


def test_signs_of_a_mode_belong_to_the_input_of_its_example():
    """A mode has the signs of its example there, also without the first interval."""
    exported_formulas = formulas(loaded(TWO_FOUR_BARS), ["theta_e"], crossings="pass")
    assert not exported_formulas.step
    smooth = exported_formulas.mode_table.smooth
    for position in modes_without_first_interval(smooth):
        mode = exported_formulas.modes[position]
        interval = np.searchsorted(smooth.starts, mode.at[0]) - 1
        assert mode.values == tuple(smooth.mode_values[interval, position]), mode


@pytest.mark.slow
def test_variables_of_a_mode_close_the_loops_at_the_input_of_its_example():
    """Newton's method starts from a configuration at the input that the source names."""
    mechanism = loaded(with_triad(TWO_FOUR_BARS))
    exported_formulas = formulas(mechanism, ["theta_e"], crossings="pass")
    step = exported_formulas.numpy_function(exported_formulas.step)
    smooth = exported_formulas.mode_table.smooth
    # Some modes have configurations in both later intervals.
    known = np.isfinite(smooth.inputs[:, modes_without_first_interval(smooth)])
    assert np.any(np.sum(known, axis=0) > 1)
    for mode in exported_formulas.modes:
        variables = np.array(mode.values)[:, None]
        after = step(np.array(mode.at)[:, None], variables, exported_formulas.size_values)
        assert after[-1, 0] < 1e-9, mode  # the closure residual
