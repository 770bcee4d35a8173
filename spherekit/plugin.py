"""What analyses and packs are written with: this module is all that a plugin imports.

The contract (`AbstractAnalysis`, `Needs`, `Batch`, `Findings`, `Sweep`), tables, scenes,
poles by name, errors, and what the shipped analyses compute with: forces and inertia,
singularities, inverse kinematics, workspaces, rotations between poses, regions of the
sphere. Names are imported when they are first read.
"""

from typing import TYPE_CHECKING

from spherekit.lazily import offered as _offered

if TYPE_CHECKING:
    from spherekit.analysis.contract import AbstractAnalysis as AbstractAnalysis
    from spherekit.analysis.contract import Batch as Batch
    from spherekit.analysis.contract import Findings as Findings
    from spherekit.analysis.contract import Needs as Needs
    from spherekit.analysis.contract import Sweep as Sweep
    from spherekit.analysis.link_scenes import link_bodies as link_bodies
    from spherekit.analysis.numbers import columns_of as columns_of
    from spherekit.analysis.numbers import read_numbers as read_numbers
    from spherekit.analysis.registry import registered as registered
    from spherekit.analysis.scene import Arrow as Arrow
    from spherekit.analysis.scene import Axis as Axis
    from spherekit.analysis.scene import Body as Body
    from spherekit.analysis.scene import Graph as Graph
    from spherekit.analysis.scene import GreatCircle as GreatCircle
    from spherekit.analysis.scene import InputMarks as InputMarks
    from spherekit.analysis.scene import Mark as Mark
    from spherekit.analysis.scene import PlaneCurve as PlaneCurve
    from spherekit.analysis.scene import Portrait as Portrait
    from spherekit.analysis.scene import Primitive as Primitive
    from spherekit.analysis.scene import Scene as Scene
    from spherekit.analysis.scene import Series as Series
    from spherekit.analysis.scene import SphereCurves as SphereCurves
    from spherekit.analysis.scene import SphereMap as SphereMap
    from spherekit.analysis.scene import Surface as Surface
    from spherekit.analysis.scene import Text as Text
    from spherekit.analysis.tables import ASSEMBLY_MODE as ASSEMBLY_MODE
    from spherekit.analysis.tables import INPUT as INPUT
    from spherekit.analysis.tables import INPUTS as INPUTS
    from spherekit.analysis.tables import RESIDUAL as RESIDUAL
    from spherekit.analysis.tables import SAMPLE as SAMPLE
    from spherekit.analysis.tables import STATUS as STATUS
    from spherekit.analysis.tables import TIME as TIME
    from spherekit.analysis.tables import Column as Column
    from spherekit.analysis.tables import Table as Table
    from spherekit.analysis.tables import TableData as TableData
    from spherekit.analysis.tables import input_columns as input_columns
    from spherekit.budget import Budget as Budget
    from spherekit.conventions import Status as Status
    from spherekit.conventions import counted as counted
    from spherekit.conventions import listing as listing
    from spherekit.conventions import nearest as nearest
    from spherekit.conventions import numbered as numbered
    from spherekit.dynamics.forces import Loads as Loads
    from spherekit.dynamics.inertia import Inertia as Inertia
    from spherekit.dynamics.inertia import inertia as inertia
    from spherekit.dynamics.inverse import driving_torque as driving_torque
    from spherekit.dynamics.inverse import need_terms as need_terms
    from spherekit.dynamics.inverse import total as total
    from spherekit.dynamics.kinematics import CoordinateMotion as CoordinateMotion
    from spherekit.errors import AnalysisError as AnalysisError
    from spherekit.errors import ModelError as ModelError
    from spherekit.errors import SolveError as SolveError
    from spherekit.guarantee import Claim as Claim
    from spherekit.guidance.follow import follow_rotation as follow_rotation
    from spherekit.guidance.loci import mid_plane_loci as mid_plane_loci
    from spherekit.guidance.mid_plane_architecture import (
        MidPlaneArchitecture as MidPlaneArchitecture,
    )
    from spherekit.guidance.mid_plane_architecture import (
        MidPlaneRotation as MidPlaneRotation,
    )
    from spherekit.guidance.poses import AtDirection as AtDirection
    from spherekit.guidance.poses import AtInputs as AtInputs
    from spherekit.guidance.poses import AtMirror as AtMirror
    from spherekit.guidance.poses import AtOrientation as AtOrientation
    from spherekit.guidance.poses import AtRotation as AtRotation
    from spherekit.guidance.poses import Pose as Pose
    from spherekit.guidance.poses import PoseCandidates as PoseCandidates
    from spherekit.guidance.poses import PoseFinder as PoseFinder
    from spherekit.guidance.rotation import FixedAxisRotation as FixedAxisRotation
    from spherekit.guidance.rotation import RotationSamples as RotationSamples
    from spherekit.guidance.rotation import chosen_output as chosen_output
    from spherekit.guidance.schedule import SHAPES as SHAPES
    from spherekit.guidance.schedule import Schedule as Schedule
    from spherekit.guidance.schedule import Timetable as Timetable
    from spherekit.guidance.schedule import quickest as quickest
    from spherekit.guidance.symmetry import mid_plane_form as mid_plane_form
    from spherekit.model.actions import used_links as used_links
    from spherekit.model.actions import used_pairs as used_pairs
    from spherekit.model.geometry import link_axes as link_axes
    from spherekit.model.mechanism import Mechanism as Mechanism
    from spherekit.model.mechanism import Output as Output
    from spherekit.motion.configuration import configuration_curves as configuration_curves
    from spherekit.motion.motion import Motion as Motion
    from spherekit.motion.motion import Tracer as Tracer
    from spherekit.planning.poles import Plan as Plan
    from spherekit.planning.poles import Pole as Pole
    from spherekit.planning.poles import all_poles as all_poles
    from spherekit.planning.poles import parse_pole as parse_pole
    from spherekit.planning.poles import pole_of as pole_of
    from spherekit.region.region import Part as Part
    from spherekit.region.region import Region as Region
    from spherekit.region.region import find_region as find_region
    from spherekit.singular.aspects import Aspects as Aspects
    from spherekit.singular.aspects import aspects as aspects
    from spherekit.singular.curves import SingularCurves as SingularCurves
    from spherekit.singular.curves import ranges_of as ranges_of
    from spherekit.singular.curves import singular_curves as singular_curves
    from spherekit.singular.points import CurveSeen as CurveSeen
    from spherekit.singular.points import SingularPoints as SingularPoints
    from spherekit.singular.points import TypeName as TypeName
    from spherekit.singular.record import RelationAt as RelationAt
    from spherekit.singular.record import SingularPoint as SingularPoint
    from spherekit.singular.record import Type as Type
    from spherekit.singular.relation import SixPoles as SixPoles
    from spherekit.singular.sampled import RelationMeasures as RelationMeasures
    from spherekit.singular.sampled import SampledSingularities as SampledSingularities
    from spherekit.singular.several import OutputCoefficients as OutputCoefficients
    from spherekit.singular.several import RowType as RowType
    from spherekit.singular.several import coefficients as coefficients
    from spherekit.singular.single import ordered_pole as ordered_pole
    from spherekit.singular.slices import Cut as Cut
    from spherekit.singular.slices import cut as cut
    from spherekit.singular.slices import solver_of as solver_of
    from spherekit.singular.stationarity import output_of as output_of
    from spherekit.singular.surface import SingularSurface as SingularSurface
    from spherekit.singular.surface import singular_surface as singular_surface
    from spherekit.sphere.mirror import mirror_angles as mirror_angles
    from spherekit.sphere.mirror import normal_at as normal_at
    from spherekit.sphere.mirror import normals_of as normals_of
    from spherekit.sphere.rotation import Floats as Floats
    from spherekit.sphere.rotation import from_quaternion as from_quaternion
    from spherekit.sphere.rotation import quaternion as quaternion
    from spherekit.sphere.tilt_torsion import azimuth_tilt as azimuth_tilt
    from spherekit.sphere.tilt_torsion import from_tilt_torsion as from_tilt_torsion
    from spherekit.sphere.tilt_torsion import pointing as pointing
    from spherekit.sphere.tilt_torsion import tilt_torsion as tilt_torsion
    from spherekit.workspace.constraints import AngleLimit as AngleLimit
    from spherekit.workspace.constraints import AxesLimit as AxesLimit
    from spherekit.workspace.constraints import Constraints as Constraints
    from spherekit.workspace.constraints import PairLimit as PairLimit
    from spherekit.workspace.constraints import bounds_of as bounds_of
    from spherekit.workspace.inverse import closed_kinematics as closed_kinematics
    from spherekit.workspace.inverse import output_kinematics as output_kinematics
    from spherekit.workspace.kinematics import ClosedKinematics as ClosedKinematics
    from spherekit.workspace.kinematics import OutputKinematics as OutputKinematics
    from spherekit.workspace.rows import InverseRows as InverseRows
    from spherekit.workspace.rows import label_of as label_of
    from spherekit.workspace.rows import sense_of as sense_of
    from spherekit.workspace.workspace import DirectionWorkspace as DirectionWorkspace
    from spherekit.workspace.workspace import Judged as Judged
    from spherekit.workspace.workspace import OrientationWorkspace as OrientationWorkspace
    from spherekit.workspace.workspace import chosen_modes as chosen_modes
    from spherekit.workspace.workspace import direction_workspaces as direction_workspaces
    from spherekit.workspace.workspace import judge as judge
    from spherekit.workspace.workspace import nearest_poses as nearest_poses
    from spherekit.workspace.workspace import nearest_reachable as nearest_reachable
    from spherekit.workspace.workspace import orientation_samples as orientation_samples
    from spherekit.workspace.workspace import (
        orientation_workspaces as orientation_workspaces,
    )

__all__, __getattr__, __dir__ = _offered(__name__, __file__)
