"""What analyses of forces compute with: inertia, loads and the driving torque."""

from typing import TYPE_CHECKING

from spherekit.lazy_imports import offered as _offered
from spherekit.plugin import _offer

if TYPE_CHECKING:
    from spherekit.dynamics.coordinates import CoordinateMotion as CoordinateMotion
    from spherekit.dynamics.coordinates import Inertia as Inertia
    from spherekit.dynamics.coordinates import driving_torques as driving_torques
    from spherekit.dynamics.coordinates import inertia as inertia
    from spherekit.dynamics.forces import Loads as Loads
    from spherekit.dynamics.inverse import InverseSolution as InverseSolution
    from spherekit.dynamics.inverse import Stiffness as Stiffness
    from spherekit.dynamics.inverse import balancing as balancing
    from spherekit.dynamics.inverse import holding_torques as holding_torques
    from spherekit.dynamics.inverse import judged as judged
    from spherekit.dynamics.inverse import need_terms as need_terms
    from spherekit.dynamics.inverse import needed_torques as needed_torques
    from spherekit.dynamics.inverse import of_parts as of_parts
    from spherekit.dynamics.inverse import output_stiffness as output_stiffness
    from spherekit.dynamics.inverse import total as total
    from spherekit.dynamics.reactions import Reactions as Reactions
    from spherekit.dynamics.reactions import reactions as reactions
    from spherekit.model.actions import acting_links as acting_links
    from spherekit.model.actions import used_links as used_links
    from spherekit.model.actions import used_pairs as used_pairs
    from spherekit.model.dynamics import Bearings as Bearings
    from spherekit.motion.motion import Timing as Timing

__all__, __getattr__, __dir__ = _offered(__name__, __file__, _offer)
