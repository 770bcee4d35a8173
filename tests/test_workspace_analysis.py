"""The analysis `workspace`: areas against quadrature, samples, bad input."""

import numpy as np
import pytest
from closed_forms import (
    MID_PLANE_LEG,
    SMALLEST_ANGLE,
    five_bar_area,
    mid_plane_area,
)
from scipy.integrate import quad
from test_inverse import mechanism_of, unlike_legs

import spherekit as sk
from spherekit.conventions import Status
from spherekit.errors import AnalysisError
from spherekit.model.mechanism import Output
from spherekit.motion.branches import Branch
from spherekit.output.forward import ForwardKinematics
from spherekit.output.inverse import InverseKinematics
from spherekit.sphere.rotation import arc, from_quaternion, transpose
from spherekit.sphere.tilt_torsion import azimuth_tilt, euler_zyz
from spherekit.workspace.constraints import AxesLimit, Constraints, PairLimit, bounds_of
from spherekit.workspace.kinematics import kinematics_of
from spherekit.workspace.workspace import (
    direction_workspaces,
    judge,
    margins_of,
    nearest_reachable,
    orientation_samples,
    orientation_workspaces,
    spread,
)

DIRECTIONS = spread(20_000)


def found_in(mechanism, **parameters):
    """Run the analysis over few samples; its result and its findings."""
    text = ",".join(f"{key}={value}" for key, value in parameters.items())
    result = sk.run(mechanism, [f"workspace:{text}"], samples=2, search=False)
    assert not result.failures
    (own,) = result.summary["analyses"]
    return result, own["findings"]


@pytest.fixture(scope="module")
def five_bar():
    return sk.load("five_bar")


@pytest.fixture(scope="module")
def mid_plane():
    return kinematics_of(sk.load("two_dof_spm"))


def ten_degrees():
    ten = np.radians(10.0)
    return Constraints(apart=(AxesLimit("21", "43", ten), AxesLimit("61", "54", ten)))


def sub_loop():
    """A five-bar of seven links: one crank is driven through a four-bar."""
    return mechanism_of(
        {
            "base": ("a1 a2 d2", [70.0, 95.0], [30.0]),
            "crank1": ("a1 b1", [50.0], []),
            "coupler1": ("b1 c", [75.0], []),
            "drive": ("d2 e2", [35.0], []),
            "rod": ("e2 f2", [78.0], []),
            "crank2": ("a2 f2 b2", [40.0, 65.0], [75.0]),
            "coupler2": ("c b2", [70.0], []),
        },
        {
            "a1": "base crank1",
            "b1": "coupler1 crank1",
            "c": "coupler1 coupler2",
            "d2": "drive base",
            "e2": "drive rod",
            "f2": "rod crank2",
            "a2": "base crank2",
            "b2": "crank2 coupler2",
        },
        ["a1", "d2"],
        Output("tip", "coupler2", "base", (0.0, 0.0, 1.0)),
        {"a1": 0.4, "d2": -0.7},
    )
