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
    from spherekit.api.designs import synthesize as synthesize
    from spherekit.api.export import export as export
    from spherekit.api.kinematics import Kinematics as Kinematics
    from spherekit.api.kinematics import evaluate as evaluate
    from spherekit.api.page import page as page
    from spherekit.api.plan import plan as plan
    from spherekit.api.run import run as run
    from spherekit.api.sweep import sweep as sweep
    from spherekit.api.trade import trade as trade
    from spherekit.dynamics.forward_dynamics import simulate as simulate
    from spherekit.dynamics.inverse_dynamics import inverse_dynamics as inverse_dynamics
    from spherekit.dynamics.reduced_model import load_reduced as load_reduced
    from spherekit.dynamics.reduced_model_maker import (
        reduced_grid_model as reduced_grid_model,
    )
    from spherekit.dynamics.reduced_model_maker import reduced_model as reduced_model
    from spherekit.dynamics.reduced_model_simulation import (
        simulate_reduced as simulate_reduced,
    )
    from spherekit.dynamics.reference_simulation import (
        reference_simulation as reference_simulation,
    )
    from spherekit.dynamics.simulation import Simulation as Simulation
    from spherekit.dynamics.simulation_start import PoseStart as PoseStart
    from spherekit.errors import SpherekitError as SpherekitError
    from spherekit.exchange.coupling_table import load_coupling as load_coupling
    from spherekit.exchange.coupling_table_maker import coupling_table as coupling_table
    from spherekit.exchange.mechanism_import import import_mechanism as import_mechanism
    from spherekit.files.library import mechanisms as mechanisms
    from spherekit.files.mechanism_reader import load as load
    from spherekit.files.mechanism_tables import build as build
    from spherekit.files.mechanism_writer import dump as dump
    from spherekit.files.study import Start as Start
    from spherekit.files.study import Study as Study
    from spherekit.files.study_reader import load_study as load_study
    from spherekit.files.time_law import ConstantSpeed as ConstantSpeed
    from spherekit.files.time_law import Cycloidal as Cycloidal
    from spherekit.files.time_law import Polynomial as Polynomial
    from spherekit.files.time_law import Tabulated as Tabulated
    from spherekit.mechanism.friction import Bearings as Bearings
    from spherekit.mechanism.friction import ContactFriction as ContactFriction
    from spherekit.mechanism.load import TorqueTable as TorqueTable
    from spherekit.mechanism.load_kinds import Damper as Damper
    from spherekit.mechanism.load_kinds import Friction as Friction
    from spherekit.mechanism.load_kinds import Gravity as Gravity
    from spherekit.mechanism.load_kinds import Moment as Moment
    from spherekit.mechanism.load_kinds import PairTorque as PairTorque
    from spherekit.mechanism.load_kinds import PointForce as PointForce
    from spherekit.mechanism.load_kinds import Spring as Spring
    from spherekit.mechanism.locking import lock as lock
    from spherekit.mechanism.mechanism import Mechanism as Mechanism
    from spherekit.outputs.fixed_axis_rotation import follow_rotation as follow_rotation
    from spherekit.outputs.fixed_axis_rotation import follow_to as follow_to
    from spherekit.outputs.forward_kinematics import ForwardKinematics as ForwardKinematics
    from spherekit.outputs.inverse_kinematics import InverseKinematics as InverseKinematics
    from spherekit.outputs.mid_plane_symmetry import mid_plane_form as mid_plane_form
    from spherekit.outputs.rotation_timing import time_optimal as time_optimal
    from spherekit.planning.plan_text import as_text as table  # noqa: F401
    from spherekit.planning.pole_plan import Plan as Plan
    from spherekit.positions.motion import Motion as Motion
    from spherekit.positions.position_analysis import trace as trace
    from spherekit.proof.balls import Digits as Digits
    from spherekit.proof.reference_rows import exact_rows as exact_rows
    from spherekit.runs.evaluation_options import Setting as Setting
    from spherekit.runs.run_result import RunResult as RunResult
    from spherekit.status import Status as Status
    from spherekit.version import __version__ as __version__

__all__, __getattr__, __dir__ = _offered(__name__, __file__)
