"""What analyses of forces compute with: inertia, loads and the driving torque."""

from typing import TYPE_CHECKING

from spherekit.lazy_imports import offered as _offered
from spherekit.plugin import _offer

if TYPE_CHECKING:
    from spherekit.dynamics.coordinates import CoordinateMotion as CoordinateMotion
    from spherekit.dynamics.coordinates import Inertia as Inertia
    from spherekit.dynamics.coordinates import driving_torques as driving_torques
    from spherekit.dynamics.coordinates import inertia as inertia
    from spherekit.dynamics.generalised_forces import Loads as Loads
    from spherekit.dynamics.inverse_dynamics import InverseSolution as InverseSolution
    from spherekit.dynamics.inverse_dynamics import Stiffness as Stiffness
    from spherekit.dynamics.inverse_dynamics import balancing as balancing
    from spherekit.dynamics.inverse_dynamics import holding_torques as holding_torques
    from spherekit.dynamics.inverse_dynamics import judged as judged
    from spherekit.dynamics.inverse_dynamics import need_terms as need_terms
    from spherekit.dynamics.inverse_dynamics import needed_torques as needed_torques
    from spherekit.dynamics.inverse_dynamics import of_parts as of_parts
    from spherekit.dynamics.inverse_dynamics import output_stiffness as output_stiffness
    from spherekit.dynamics.inverse_dynamics import total as total
    from spherekit.dynamics.reactions import Reactions as Reactions
    from spherekit.dynamics.reactions import reactions as reactions
    from spherekit.mechanism.friction import Bearings as Bearings
    from spherekit.mechanism.load_dependence import acting_links as acting_links
    from spherekit.mechanism.load_dependence import used_links as used_links
    from spherekit.mechanism.load_dependence import used_pairs as used_pairs
    from spherekit.positions.timing import Timing as Timing

__all__, __getattr__, __dir__ = _offered(__name__, __file__, _offer)
