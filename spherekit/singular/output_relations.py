"""The relations of one input and its outputs, and what they say of singularities.

c and d of the input-output relation c y' = d q' are compared with the rates themselves:
they vanish also where the four links are badly chosen.
"""

from collections.abc import Callable, Sequence
from typing import final

import numpy as np

from spherekit.model.mechanism import Mechanism
from spherekit.planning.poles import Pole, pole_of
from spherekit.singular.along import AlongCurve, Axis
from spherekit.singular.conditions import TOLERANCE, conditions
from spherekit.singular.record import AlongOutput, RelationAt, Type
from spherekit.singular.relation import (
    FourLinks,
    LinkCount,
    Relation,
    SixPoles,
    best_fourth,
    form_i,
    form_ii,
)
from spherekit.singular.roots import CommonRoots, poles_of
from spherekit.sphere.rotation import Floats

Make = Callable[[FourLinks, SixPoles], Relation | None]


@final
class OutputRelations:
    """The relations of an input and some outputs, in form i and form ii.

    Parameters
    ----------
    mechanism
        A mechanism with one freedom.
    alongs
        Its configuration curves, which a fourth link for form ii is chosen by.
    input, outputs
        (i, r) and for each output (o, s), numbers of links.

    Attributes
    ----------
    first_links, second_links
        For each output the links of form i, and those of form ii or None.
    """

    def __init__(
        self,
        mechanism: Mechanism,
        alongs: Sequence[AlongCurve],
        input: tuple[int, int],
        outputs: Sequence[tuple[int, int]],
    ) -> None:
        self.mechanism, self.input = mechanism, input
        self.first_links = tuple(FourLinks(*input, *out) for out in outputs)
        self.second_links = tuple(
            self._second_links(links, alongs) for links in self.first_links
        )

    def at(self, along: AlongCurve, s: Floats, output: int) -> AlongOutput:
        """Return rates and relations of an output at places s (n,) of a curve.

        Rates are by arc length. c and d are NaN where an axis is not known.
        """
        links = self.first_links[output]
        q, _ = rate_between(along, links.i, links.r, s)
        y, _ = rate_between(along, links.o, links.s, s)
        made = self.made(output, along.oriented(s, self.poles(output)))
        return AlongOutput(
            s,
            q,
            y,
            tuple(relation for _, _, relation in made),
            tuple(four for four, _, _ in made),
            tuple(six for _, six, _ in made),
        )

    def _second_links(
        self, links: FourLinks, alongs: Sequence[AlongCurve]
    ) -> FourLinks | None:
        """Return the links of form ii, with a fourth one where r and s are one."""
        if links.o in (links.r, links.i):
            return None
        if links.s != links.r:
            return links
        candidates = [
            k
            for k in range(len(self.mechanism.links))
            if k not in (links.i, links.r, links.o)
        ]
        wanted = [pole_of(a, k) for k in candidates for a in (links.o, links.i)]
        directions: dict[int, list[list[Floats]]] = {k: [[], []] for k in candidates}
        for along in alongs:
            axes = along.axes(along.curve.s, wanted)
            for k in candidates:
                for n, a in enumerate((links.o, links.i)):
                    directions[k][n].append(axes[pole_of(a, k)].unit)
        if not alongs:
            return links.with_s(candidates[0]) if candidates else None
        best = best_fourth(
            {k: (np.concatenate(a), np.concatenate(b)) for k, (a, b) in directions.items()}
        )
        return None if best is None else links.with_s(best)

    def poles(self, output: int) -> list[Pole]:
        """Return the poles of an output's relations, each once."""
        poles: list[Pole] = []
        for links in (self.first_links[output], self.second_links[output]):
            if links is not None:
                poles += poles_of(links)
        return list(dict.fromkeys(poles))

    def made(
        self, output: int, axes: dict[Pole, Axis]
    ) -> list[tuple[FourLinks, SixPoles, Relation]]:
        """Return links, poles and relation of form i and, if there is one, form ii."""
        out = []
        second = self.second_links[output]
        pairs: list[tuple[FourLinks, Make]] = [(self.first_links[output], form_i)]
        if second is not None:
            pairs.append((second, form_ii))
        for links, make in pairs:
            six = SixPoles.of(links, lambda a, b: axes[pole_of(a, b)].unit)
            relation = make(links, six)
            if relation is not None:
                out.append((links, six, relation))
        return out

    def at_groups(
        self,
        output: int,
        axes: dict[Pole, Axis],
        along: AlongCurve,
        s: Floats,
        groups: list[CommonRoots],
    ) -> list[list[RelationAt]]:
        """Return for each form its relation at each group."""
        driven = pole_of(*self.input)
        out = []
        for links, six, relation in self.made(output, axes):
            q, _ = rate_between(along, links.i, links.r, s)
            y, _ = rate_between(along, *relation.output, s)
            facts = [group.kind(driven, pole_of(*relation.output)) for group in groups]
            errors = axes_error(links, axes)
            resting = [group.resting(links) for group in groups]
            out.append(self.judged(links, six, relation, q, y, errors, facts, resting))
        return out

    def judged(
        self,
        links: FourLinks,
        six: SixPoles,
        relation: Relation,
        q: Floats,
        y: Floats,
        errors: Floats,
        facts: list[Type],
        resting: list[list[tuple[int, int]]],
    ) -> list[RelationAt]:
        """Return a relation at n configurations, compared with what the rates say."""
        names = self.mechanism.links
        allowed = np.maximum(TOLERANCE, 10.0 * errors)
        no_c, no_d = np.abs(relation.c) <= allowed, np.abs(relation.d) <= allowed
        types = [
            {(1, 1): Type.III, (1, 0): Type.II, (0, 1): Type.I}.get((int(a), int(b)))
            for a, b in zip(no_c, no_d, strict=True)
        ]
        held = {
            kind: conditions(relation, links, six, names, kind, errors)
            for kind in {str(kind) for kind in types if kind is not None}
        }
        gaps = relation.residual(y, q)
        out = []
        for k, kind in enumerate(types):
            told = {Type.APPARENT: None, Type.SELF_MOTION: Type.III}
            fact = told.get(facts[k], facts[k])
            out.append(
                RelationAt(
                    form=relation.form,
                    kind=relation.kind,
                    links=links,
                    output=relation.output,
                    c=float(relation.c[k]),
                    d=float(relation.d[k]),
                    error=float(errors[k]),
                    residual=float(gaps[k]),
                    type=kind,
                    conditions=() if kind is None else held[str(kind)][k],
                    agrees=kind == fact,
                    note=_disagreement(names, kind, fact, relation, resting[k]),
                )
            )
        return out


def rate_between(along: AlongCurve, of: int, to: int, s: Floats) -> tuple[Floats, Floats]:
    """Return the rate of a link relative to another at s, and its slope, (n,)."""
    rate = along.signed(pole_of(of, to), s)
    sign = 1.0 if of > to else -1.0
    return sign * rate.w, sign * rate.dw


def axes_error(links: FourLinks, axes: dict[Pole, Axis]) -> Floats:
    """Return (n,) the largest error bound of the axes of four links."""
    errors = np.stack([axes[pole].error for pole in poles_of(links)])
    return np.asarray(np.max(errors, axis=0))


def _disagreement(
    names: Sequence[str],
    kind: Type | None,
    fact: Type | None,
    relation: Relation,
    resting: list[tuple[int, int]],
) -> str:
    """Return why the coefficients say something else than the rates."""
    if kind == fact:
        return ""
    if relation.kind == LinkCount.SAME_POLE:
        return "the output is the input, and c and d are constant"
    if kind == Type.III:
        output = pole_of(*relation.output)
        still = [f"{names[a]} and {names[b]}" for a, b in resting if (a, b) != output]
        cause = (
            "links " + ", ".join(still) + " stand still relative to each other"
            if still
            else "the six axes of the chosen links lie in one plane"
        )
        what = "neither rate vanishes" if fact is None else f"the rates say type {fact}"
        return f"c = d = 0, but {what}: {cause}; a relation of other links decides"
    if fact == Type.III and kind is None:
        return (
            "input and output stand still together while other links move; c and d do not "
            "vanish, and y'/q' = d/c stays finite"
        )
    told, wanted = (
        "nothing vanishes" if case is None else f"type {case}" for case in (kind, fact)
    )
    return (
        f"c and d say: {told}; the rates: {wanted}; a coefficient nearly vanishes, or is "
        "not known well enough"
    )
