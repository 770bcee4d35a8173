"""Functions for analyses of forces: inertia, loads and driving torques."""

from spherekit.dynamics.coordinates import CoordinateMotion
from spherekit.dynamics.generalised_forces import Loads
from spherekit.dynamics.inertia import Inertia, driving_torques, inertia
from spherekit.dynamics.inverse_dynamics import (
    InverseSolution,
    balancing,
    holding_torques,
    judged,
    need_terms,
    needed_torques,
    of_parts,
    total,
)
from spherekit.dynamics.output_stiffness import Stiffness, output_stiffness
from spherekit.dynamics.reactions import Reactions, reactions
from spherekit.mechanism.friction import Bearings
from spherekit.mechanism.load_dependence import acting_links, used_links, used_pairs
from spherekit.positions.timing import Timing

__all__ = [
    "Bearings",
    "CoordinateMotion",
    "Inertia",
    "InverseSolution",
    "Loads",
    "Reactions",
    "Stiffness",
    "Timing",
    "acting_links",
    "balancing",
    "driving_torques",
    "holding_torques",
    "inertia",
    "judged",
    "need_terms",
    "needed_torques",
    "of_parts",
    "output_stiffness",
    "reactions",
    "total",
    "used_links",
    "used_pairs",
]
