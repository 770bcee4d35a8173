"""What an analysis declares to read."""

from dataclasses import dataclass

from spherekit.planning.pole_plan import Pole


@dataclass(frozen=True)
class Needs:
    """What an analysis reads, by link numbers, pair names and link names.

    `directions`: poles whose axis direction is wanted. `rates`: poles whose velocity
    coefficient is wanted too; with `derivatives`, also its derivative by the input.
    `turns`: poles whose direction's derivative is wanted, with `derivatives`.
    `planes`: poles whose two great circles are wanted. `link_rates`: links whose angular
    velocity per unit rate of the input is wanted, `pair_rates`: pairs whose variable's
    rate is; with `derivatives`, also the derivative of the former. `pair_values`,
    `rotations`: pairs and links. `continued_values`: pairs whose variable is wanted
    without jumps of a turn. All five by name. `time`: when the rows happen, with
    the rates and accelerations of the inputs. `tracer`: what finds configurations, for
    an analysis that asks for more of them than the samples; `links` are the numbers of
    those whose motion relative to the input it asks about, none if about all.
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
        """Return what two analyses need together."""
        return Needs(
            **{name: held | getattr(other, name) for name, held in vars(self).items()}
        )
