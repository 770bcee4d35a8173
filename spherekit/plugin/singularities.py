"""Functions for analyses of singularities: points, relations, curves and aspects."""

from spherekit.completeness import Completeness, Guarantee
from spherekit.mechanism.output_choice import observed_outputs
from spherekit.outputs.mid_plane_loci import mid_plane_loci
from spherekit.planning.pole_plan import ordered_pole
from spherekit.positions.assembly_enumeration import group_signs
from spherekit.singularities.aspects import Aspects, aspects
from spherekit.singularities.curve_starts import ranges_of
from spherekit.singularities.geometric_conditions import RelationAt
from spherekit.singularities.grashof import Grashof, grashof
from spherekit.singularities.input_output_relation import SixPoles, Type
from spherekit.singularities.near_misses import NearMiss, least_transmission, near_misses
from spherekit.singularities.sampled_singularities import SampledSingularities
from spherekit.singularities.several_inputs import (
    OutputCoefficients,
    RowType,
    coefficients,
    what_vanishes,
)
from spherekit.singularities.singular_curves import (
    CurveSeen,
    SingularCurves,
    moved_by_all,
    singular_curves,
)
from spherekit.singularities.singular_point import SingularPoint
from spherekit.singularities.singular_surface import SingularSurface, singular_surface
from spherekit.singularities.singularity_report import LocusName, SingularPoints
from spherekit.singularities.slices import LockedInputSection, cut, solver_of
from spherekit.singularities.stationarity import output_of
from spherekit.time_limit import TimeLimit
from spherekit.velocities.transmission_angle import (
    NEAREST_TRANSMISSION_REDUCTION,
    NEAREST_TRANSMISSION_WORD,
)

__all__ = [
    "NEAREST_TRANSMISSION_REDUCTION",
    "NEAREST_TRANSMISSION_WORD",
    "Aspects",
    "Completeness",
    "CurveSeen",
    "Grashof",
    "Guarantee",
    "LockedInputSection",
    "LocusName",
    "NearMiss",
    "OutputCoefficients",
    "RelationAt",
    "RowType",
    "SampledSingularities",
    "SingularCurves",
    "SingularPoint",
    "SingularPoints",
    "SingularSurface",
    "SixPoles",
    "TimeLimit",
    "Type",
    "aspects",
    "coefficients",
    "cut",
    "grashof",
    "group_signs",
    "least_transmission",
    "mid_plane_loci",
    "moved_by_all",
    "near_misses",
    "observed_outputs",
    "ordered_pole",
    "output_of",
    "ranges_of",
    "singular_curves",
    "singular_surface",
    "solver_of",
    "what_vanishes",
]
