"""What analyses of singularities compute with: places, relations, curves, aspects."""

from typing import TYPE_CHECKING

from spherekit.lazy_imports import offered as _offered
from spherekit.plugin import _offer

if TYPE_CHECKING:
    from spherekit.guarantee import Completeness as Completeness
    from spherekit.guarantee import TimeLimit as TimeLimit
    from spherekit.guidance.loci import mid_plane_loci as mid_plane_loci
    from spherekit.motion.elimination import group_signs as group_signs
    from spherekit.planning.poles import ordered_pole as ordered_pole
    from spherekit.singular.aspects import Aspects as Aspects
    from spherekit.singular.aspects import aspects as aspects
    from spherekit.singular.curves import CurveSeen as CurveSeen
    from spherekit.singular.curves import SingularCurves as SingularCurves
    from spherekit.singular.curves import moved_by_all as moved_by_all
    from spherekit.singular.curves import singular_curves as singular_curves
    from spherekit.singular.grashof import Grashof as Grashof
    from spherekit.singular.grashof import NearMiss as NearMiss
    from spherekit.singular.grashof import grashof as grashof
    from spherekit.singular.grashof import least_transmission as least_transmission
    from spherekit.singular.grashof import near_misses as near_misses
    from spherekit.singular.locus import LockedInputSection as LockedInputSection
    from spherekit.singular.locus import cut as cut
    from spherekit.singular.locus import solver_of as solver_of
    from spherekit.singular.record import RelationAt as RelationAt
    from spherekit.singular.record import SingularPoint as SingularPoint
    from spherekit.singular.relation import SixPoles as SixPoles
    from spherekit.singular.relation import Type as Type
    from spherekit.singular.sampled import SampledSingularities as SampledSingularities
    from spherekit.singular.several import LocusName as LocusName
    from spherekit.singular.several import OutputCoefficients as OutputCoefficients
    from spherekit.singular.several import RowType as RowType
    from spherekit.singular.several import SingularPoints as SingularPoints
    from spherekit.singular.several import coefficients as coefficients
    from spherekit.singular.several import what_vanishes as what_vanishes
    from spherekit.singular.starts import ranges_of as ranges_of
    from spherekit.singular.stationarity import output_of as output_of
    from spherekit.singular.surface import SingularSurface as SingularSurface
    from spherekit.singular.surface import singular_surface as singular_surface

__all__, __getattr__, __dir__ = _offered(__name__, __file__, _offer)
