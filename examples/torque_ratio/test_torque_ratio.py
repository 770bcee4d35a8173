"""The analysis keeps to the contract of spherekit's plugins."""

from spherekit.plugin import conformance
from spherekit_torque_ratio import TorqueRatio


def test_conformance() -> None:
    """Print and check every line of the conformance check."""
    print(conformance(TorqueRatio))
