"""The declaration of what an analysis reads."""

from dataclasses import dataclass

from spherekit.planning.pole_plan import Pole


@dataclass(frozen=True)
class Needs:
    """Declares which quantities an analysis reads from a `Batch`.

    A `Batch` has the results for a group of samples. A run evaluates only what its analyses
    declare. A pole is the axis about which one link rotates relative to another. It is
    given as the tuple of the indices of both links, the smaller index first. Pairs are
    given by name, and so are links in `rotations` and `link_rates`.

    Attributes
    ----------
    directions
        Poles for which the axis direction is read.
    rates
        Poles for which the direction and velocity coefficient (angular velocity about the
        pole per unit rate of the input) are read. With `derivatives`, the acceleration
        coefficient of these poles can be read too.
    derivatives
        Whether derivatives with respect to the input are read, for the poles and links in
        `rates`, `turns` and `link_rates`.
    planes
        Poles for which two great circles are read that intersect in the pole. The method
        `Batch.planes` returns the normals of their planes.
    pair_values
        Pairs for which the variable is read, in rad, passive angles within (-pi, pi].
    continued_values
        Pairs for which the variable is read without jumps of whole revolutions.
    rotations
        Links for which the rotation matrix is read.
    link_rates
        Links for which the angular velocity per unit rate of the input is read.
    pair_rates
        Pairs for which the rate per unit rate of the input is read.
    time
        Whether the time of each row and the rates and accelerations of the inputs are read.
    tracer
        Whether the analysis uses the position analysis of the run, in order to compute
        configurations beyond the samples, such as configurations along a curve.
    turns
        Poles for which the turning of the axis is read: the derivatives of the axis
        direction with respect to the input. These poles need `derivatives`.
    links
        Indices of the links that an analysis with `tracer` reads. If the set is empty, the
        analysis reads all links. Do not read this set from the result of `union`: there,
        it can be too small.
    """

    directions: frozenset[Pole] = frozenset()
    rates: frozenset[Pole] = frozenset()
    derivatives: bool = False
    planes: frozenset[Pole] = frozenset()
    pair_values: frozenset[str] = frozenset()
    continued_values: frozenset[str] = frozenset()
    rotations: frozenset[str] = frozenset()
    link_rates: frozenset[str] = frozenset()
    pair_rates: frozenset[str] = frozenset()
    time: bool = False
    tracer: bool = False
    turns: frozenset[Pole] = frozenset()
    links: frozenset[int] = frozenset()

    def union(self, other: "Needs") -> "Needs":
        """Return what two analyses need together.

        The attribute `links` of the result is not valid, because an empty set means all
        links. If one analysis reads all links, the union contains only the links of the
        other one. Read `links` from the needs of each analysis instead.
        """
        # The operator | is the union of two sets, and "or" of two booleans.
        return Needs(
            **{name: value | getattr(other, name) for name, value in vars(self).items()}
        )
