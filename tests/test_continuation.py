"""What curves are followed by: slopes of the Jacobian, and many curves at once."""

import numpy as np
import pytest

from spherekit.files.read import load
from spherekit.motion.guides import follow_each
from spherekit.motion.motion import PositionAnalysis


@pytest.mark.parametrize("name", ["four_bar", "roller_cam", "two_contacts"])
def test_the_bias_is_the_slope_of_the_jacobian_along_the_rates(name):
    tracer = PositionAnalysis(load(name), samples=5)
    motion = tracer.motion()
    closure, values = tracer.solver.closure, motion.values[~motion.failed]
    at = closure.at(values)
    rates = np.linalg.svd(at.jacobian)[2][:, -1]
    h = 1e-5
    ahead, back = (closure.at(values + s * rates).jacobian for s in (h, -h))
    slope = np.einsum("nij,nj->ni", (ahead - back) / (2.0 * h), rates)
    assert np.max(np.abs(at.bias(rates) - slope)) < 1e-7


@pytest.mark.parametrize("name", ["single_flier", "shaped_cam"])
def test_curves_followed_side_by_side_are_those_of_each(name):
    tracer = PositionAnalysis(load(name))
    closure, driven = tracer.solver.closure, tracer.solver.driven[0]
    guides = [mode.guide for mode in tracer.assembly_modes]
    values = np.array([guide.values[len(guide.values) // 3] for guide in guides])
    together = follow_each(closure, driven, values, *tracer.range)
    for one, curve in zip(values, together, strict=True):
        (alone,) = follow_each(closure, driven, one[None], *tracer.range)
        assert (curve.ends, curve.tried) == (alone.ends, alone.tried)
        assert np.max(np.abs(curve.values - alone.values)) < 1e-12
