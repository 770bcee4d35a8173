"""spherekit: analysis of spherical mechanisms from their link/pair graph.

import spherekit as sk

mechanism = sk.load("four_bar")
plan = sk.plan(mechanism)
motion = sk.trace(mechanism, samples=361)
result = sk.run(mechanism, "poles", samples=361)
result.frame()
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from spherekit.version import __version__ as __version__

if TYPE_CHECKING:
    from spherekit.analysis.contract import AbstractAnalysis as AbstractAnalysis
    from spherekit.analysis.contract import Batch as Batch
    from spherekit.analysis.contract import Needs as Needs
    from spherekit.analysis.result import RunResult as RunResult
    from spherekit.analysis.run import run as run
    from spherekit.conventions import Status as Status
    from spherekit.errors import SpherekitError as SpherekitError
    from spherekit.files.read import load as load
    from spherekit.files.study import load_study as load_study
    from spherekit.files.write import dump as dump
    from spherekit.guidance.follow import follow_rotation as follow_rotation
    from spherekit.guidance.follow import follow_to as follow_to
    from spherekit.guidance.schedule import quickest as quickest
    from spherekit.guidance.symmetry import mid_plane_form as mid_plane_form
    from spherekit.model.mechanism import Mechanism as Mechanism
    from spherekit.model.study import Study as Study
    from spherekit.motion.motion import Motion as Motion
    from spherekit.motion.motion import trace as trace
    from spherekit.output.forward import ForwardKinematics as ForwardKinematics
    from spherekit.output.inverse import InverseKinematics as InverseKinematics
    from spherekit.planning.poles import Plan as Plan
    from spherekit.planning.poles import plan as plan
    from spherekit.planning.table import as_text as table  # noqa: F401

_HOME = {
    "AbstractAnalysis": "spherekit.analysis.contract:AbstractAnalysis",
    "Batch": "spherekit.analysis.contract:Batch",
    "ForwardKinematics": "spherekit.output.forward:ForwardKinematics",
    "InverseKinematics": "spherekit.output.inverse:InverseKinematics",
    "Mechanism": "spherekit.model.mechanism:Mechanism",
    "Motion": "spherekit.motion.motion:Motion",
    "Needs": "spherekit.analysis.contract:Needs",
    "Plan": "spherekit.planning.poles:Plan",
    "RunResult": "spherekit.analysis.result:RunResult",
    "SpherekitError": "spherekit.errors:SpherekitError",
    "Status": "spherekit.conventions:Status",
    "Study": "spherekit.model.study:Study",
    "dump": "spherekit.files.write:dump",
    "follow_rotation": "spherekit.guidance.follow:follow_rotation",
    "follow_to": "spherekit.guidance.follow:follow_to",
    "load": "spherekit.files.read:load",
    "load_study": "spherekit.files.study:load_study",
    "mid_plane_form": "spherekit.guidance.symmetry:mid_plane_form",
    "plan": "spherekit.planning.poles:plan",
    "quickest": "spherekit.guidance.schedule:quickest",
    "run": "spherekit.analysis.run:run",
    "table": "spherekit.planning.table:as_text",
    "trace": "spherekit.motion.motion:trace",
}

__all__ = ["__version__", *_HOME]


def __getattr__(name: str) -> Any:
    """Import a public name on first use, so that importing spherekit stays light."""
    if name not in _HOME:
        raise AttributeError(f"module 'spherekit' has no attribute {name!r}")
    module, _, attribute = _HOME[name].partition(":")
    value = getattr(import_module(module), attribute)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted(__all__)
