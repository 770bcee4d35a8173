"""spherekit: analysis of spherical mechanisms from their link/pair graph.

Angles are in rad, vectors in ground axes; wherever a mechanism is asked for, the name of a
shipped one or the path of a file will do. Everything that spherekit raises on purpose is a
`SpherekitError`.

import numpy as np
import spherekit as sk

sk.mechanisms()                                # what is shipped
mechanism = sk.load("four_bar")
longer = mechanism.with_sizes(angle_unit="deg", arcs={"2": 25.0})
print(sk.table(sk.plan(mechanism)))            # how every pole axis is found
here = sk.evaluate(longer, 0.7, assembly_mode=0)
here.velocity_coefficient("4/1"), here.direction("3/1")
turn = sk.evaluate(longer, np.linspace(0.1, 6.2, 50), assembly_mode=0)
turn.q, turn.velocity_coefficient("4/1")       # (50,) each, for a plot of your own
made = sk.build("wrist", angle_unit="deg", ground="base",     # without a file
                links={"base": {"axes": ["drive", "hinge"], "arcs": [60]},
                       "crank": {"axes": ["drive", "tip"], "arcs": [20]},
                       "coupler": {"axes": ["tip", "joint"], "arcs": [70]},
                       "rocker": {"axes": ["hinge", "joint"], "arcs": [40]}},
                pairs={"drive": ["base", "crank"], "tip": ["crank", "coupler"],
                       "joint": ["coupler", "rocker"], "hinge": ["base", "rocker"]})
motion = sk.trace(made, samples=361)           # every assembly mode
result = sk.run(mechanism, "poles", samples=361)
result.frame()                                 # pandas
result.plot("velocity coefficients")           # matplotlib
result.save("four_bar.rrd")                    # a recording for the viewer
falling = sk.simulate(mechanism, sk.Start(q=0.3), 5.0, torque=lambda t, q, dq: -0.5 * dq)
falling.at(np.linspace(0.0, 5.0, 101)).q
"""

from typing import TYPE_CHECKING

from spherekit.lazy_imports import offered as _offered

if TYPE_CHECKING:
    from spherekit.analysis.result import RunResult as RunResult
    from spherekit.analysis.running.evaluation import Setting as Setting
    from spherekit.conventions import Status as Status
    from spherekit.dynamics.forward import simulate as simulate
    from spherekit.dynamics.inverse import inverse_dynamics as inverse_dynamics
    from spherekit.dynamics.reference import reference_simulation as reference_simulation
    from spherekit.dynamics.simulation import Simulation as Simulation
    from spherekit.dynamics.start import PoseStart as PoseStart
    from spherekit.dynamics.tabulate import reduced_grid_model as reduced_grid_model
    from spherekit.dynamics.tabulate import reduced_model as reduced_model
    from spherekit.dynamics.tabulate import simulate_reduced as simulate_reduced
    from spherekit.dynamics.tabulated import load_reduced as load_reduced
    from spherekit.errors import SpherekitError as SpherekitError
    from spherekit.exchange.coupling import load_coupling as load_coupling
    from spherekit.exchange.coupling_made import coupling_table as coupling_table
    from spherekit.exchange.imported import import_mechanism as import_mechanism
    from spherekit.files.build import build as build
    from spherekit.files.library import mechanisms as mechanisms
    from spherekit.files.read import load as load
    from spherekit.files.study import load_study as load_study
    from spherekit.files.write import dump as dump
    from spherekit.front.designs import sweep as sweep
    from spherekit.front.designs import synthesize as synthesize
    from spherekit.front.evaluate import Kinematics as Kinematics
    from spherekit.front.evaluate import evaluate as evaluate
    from spherekit.front.export import export as export
    from spherekit.front.export import plan as plan
    from spherekit.front.page import page as page
    from spherekit.front.run import run as run
    from spherekit.front.run import trade as trade
    from spherekit.guidance.follow import follow_rotation as follow_rotation
    from spherekit.guidance.follow import follow_to as follow_to
    from spherekit.guidance.loci import mid_plane_form as mid_plane_form
    from spherekit.guidance.rotation import time_optimal as time_optimal
    from spherekit.model.dynamics import Bearings as Bearings
    from spherekit.model.dynamics import ContactFriction as ContactFriction
    from spherekit.model.dynamics import Damper as Damper
    from spherekit.model.dynamics import Friction as Friction
    from spherekit.model.dynamics import Gravity as Gravity
    from spherekit.model.dynamics import Moment as Moment
    from spherekit.model.dynamics import PairTorque as PairTorque
    from spherekit.model.dynamics import PointForce as PointForce
    from spherekit.model.dynamics import Spring as Spring
    from spherekit.model.load import TorqueTable as TorqueTable
    from spherekit.model.locking import lock as lock
    from spherekit.model.mechanism import Mechanism as Mechanism
    from spherekit.model.study import ConstantSpeed as ConstantSpeed
    from spherekit.model.study import Cycloidal as Cycloidal
    from spherekit.model.study import Polynomial as Polynomial
    from spherekit.model.study import Start as Start
    from spherekit.model.study import Study as Study
    from spherekit.model.study import Tabulated as Tabulated
    from spherekit.motion.motion import Motion as Motion
    from spherekit.motion.motion import trace as trace
    from spherekit.output.forward import ForwardKinematics as ForwardKinematics
    from spherekit.output.inverse import InverseKinematics as InverseKinematics
    from spherekit.planning.poles import Plan as Plan
    from spherekit.planning.poles import as_text as table  # noqa: F401
    from spherekit.proof.balls import Digits as Digits
    from spherekit.proof.rows import exact_rows as exact_rows
    from spherekit.version import __version__ as __version__

__all__, __getattr__, __dir__ = _offered(__name__, __file__)
