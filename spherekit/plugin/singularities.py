"""What analyses of singularities compute with: places, relations, curves, aspects."""

from typing import TYPE_CHECKING

from spherekit.lazy_imports import offered as _offered
from spherekit.plugin import _offer

if TYPE_CHECKING:
    from spherekit.completeness import Completeness as Completeness
    from spherekit.completeness import TimeLimit as TimeLimit
    from spherekit.outputs.mid_plane_loci import mid_plane_loci as mid_plane_loci
    from spherekit.planning.pole_plan import ordered_pole as ordered_pole
    from spherekit.positions.assembly_enumeration import group_signs as group_signs
    from spherekit.singularities.aspects import Aspects as Aspects
    from spherekit.singularities.aspects import aspects as aspects
    from spherekit.singularities.curve_starts import ranges_of as ranges_of
    from spherekit.singularities.geometric_conditions import RelationAt as RelationAt
    from spherekit.singularities.grashof import Grashof as Grashof
    from spherekit.singularities.grashof import grashof as grashof
    from spherekit.singularities.input_output_relation import SixPoles as SixPoles
    from spherekit.singularities.input_output_relation import Type as Type
    from spherekit.singularities.near_misses import NearMiss as NearMiss
    from spherekit.singularities.near_misses import least_transmission as least_transmission
    from spherekit.singularities.near_misses import near_misses as near_misses
    from spherekit.singularities.sampled_singularities import (
        SampledSingularities as SampledSingularities,
    )
    from spherekit.singularities.several_inputs import LocusName as LocusName
    from spherekit.singularities.several_inputs import (
        OutputCoefficients as OutputCoefficients,
    )
    from spherekit.singularities.several_inputs import RowType as RowType
    from spherekit.singularities.several_inputs import SingularPoints as SingularPoints
    from spherekit.singularities.several_inputs import coefficients as coefficients
    from spherekit.singularities.several_inputs import what_vanishes as what_vanishes
    from spherekit.singularities.singular_curves import CurveSeen as CurveSeen
    from spherekit.singularities.singular_curves import SingularCurves as SingularCurves
    from spherekit.singularities.singular_curves import moved_by_all as moved_by_all
    from spherekit.singularities.singular_curves import singular_curves as singular_curves
    from spherekit.singularities.singular_point import SingularPoint as SingularPoint
    from spherekit.singularities.singular_surface import SingularSurface as SingularSurface
    from spherekit.singularities.singular_surface import (
        singular_surface as singular_surface,
    )
    from spherekit.singularities.slices import LockedInputSection as LockedInputSection
    from spherekit.singularities.slices import cut as cut
    from spherekit.singularities.slices import solver_of as solver_of
    from spherekit.singularities.stationarity import output_of as output_of

__all__, __getattr__, __dir__ = _offered(__name__, __file__, _offer)
