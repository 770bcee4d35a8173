"""Figures of merit of designs: by a kernel for all of them at once, or one by one."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import cached_property
from itertools import product
from typing import Any, final

import numpy as np
from numpy.typing import NDArray

from spherekit.analysis.merit import Merit
from spherekit.conventions import TURN
from spherekit.design.all_solutions import StartSet, start_set
from spherekit.design.figures import (
    BLOCK,
    IMPOSSIBLE,
    NEVER,
    NEVER_CLOSES,
    DesignSamples,
    Evaluated,
    KernelFigures,
    refused,
)
from spherekit.design.file_numbers import OK, UNLIKE
from spherekit.design.followed_modes import Modes, followed_modes
from spherekit.design.kernel_turns import KernelTurns
from spherekit.design.profile_numbers import tracks_of
from spherekit.design.variables import (
    ACTIONS,
    DesignVariable,
    design_geometry,
    design_variable,
    designed,
    sizes_of,
)
from spherekit.design.varied import VariedMechanism
from spherekit.engine.design_kernel import (
    DesignKernel,
    PathKernel,
    arc_function,
    design_kernel,
    path_kernel,
)
from spherekit.engine.hinges import hinged
from spherekit.engine.row_quantities import (
    DesignTerms,
)
from spherekit.engine.turns import turning_pairs
from spherekit.errors import DesignError, SpherekitError
from spherekit.files.document import Document
from spherekit.guarantee import Guarantee
from spherekit.model.actions import need_tabulated
from spherekit.model.mechanism import Mechanism
from spherekit.model.parts import SizeGeometry
from spherekit.motion.assembly_modes import Solver
from spherekit.motion.input_grid import InputGrid
from spherekit.motion.motion import Motion, Tracer
from spherekit.planning.assembly import plan_assembly
from spherekit.singular.grashof import class_of, four_bar_links
from spherekit.sphere.rotation import Floats

PART, FOLLOWED, SINGLY = 16384, 768, 16
"""Designs in a part: in closed form, followed, and one by one."""

FEWEST, PARTS = 256, 8
"""Designs that are followed in a part at least, and parts that are made of more."""

ON_THE_WAY = 2**25
"""Variables of all solutions of designs that are followed together, at all samples."""

COMPLETE, SAMPLED = Guarantee.COMPLETE.value, Guarantee.SAMPLED.value

SAME_INPUT = 1e-9
"""Inputs (rad) that differ by less are those of one sample."""


@final
class Evaluator:
    """The figures of merit of designs of one topology.

    Sizes that kernels take are varied in one kernel for all designs: in closed form where
    every group is a dyad, else with all solutions followed from design to design. Numbers
    of masses and loads are inputs of the kernel too, read design by design. Mechanisms in
    contact and designs of which a solution was lost are taken one by one.
    """

    def __init__(
        self,
        document: Document,
        mechanism: Mechanism,
        variables: Sequence[DesignVariable],
        merits: Sequence[Merit],
        samples: DesignSamples,
    ) -> None:
        self.document, self.mechanism, self.inputs = document, mechanism, samples.inputs
        self.variables, self.samples = tuple(variables), samples
        self.figures = KernelFigures(mechanism, merits, samples)
        if any(name.startswith("torque") for name in self.figures.columns):
            need_tabulated(mechanism, samples.rows[:, -1])
        contacts = hinged(mechanism, self.inputs) if mechanism.has_contacts else None
        self.varied = VariedMechanism(
            document, mechanism, variables, self.inputs, contacts, self._masses_follow
        )
        self._paths: tuple[PathKernel, StartSet] | None = None
        self.kernel = self._kernel()

    def _kernel(self) -> DesignKernel | None:
        """Return the kernel of all designs, None where they have none."""
        if self.mechanism.has_contacts:
            if self.varied.contacts is None:
                return None
        elif any(v.slot is None and v.path[0] not in ACTIONS for v in self.variables):
            return None
        terms = self.varied.terms()
        if not terms.closed_form:
            paths = path_kernel(terms)
            start = start_set(paths, self.varied.nominal, *self._every_size())
            if start is None:
                return None
            self._paths = paths, start
        return design_kernel(terms, self.figures.columns)

    def _every_size(self) -> tuple[DesignTerms, Floats]:
        """Return terms of all sizes of the mechanism, and what these are in the file."""
        contacts = self.varied.contacts
        if contacts is not None:
            terms = DesignTerms.of(
                contacts.mechanism,
                self.inputs,
                [f"turned_{k}" for k in range(len(contacts.numbers))],
                lambda numbers: contacts.pairs(dict(enumerate(numbers.values()))),
                closed_form=False,
            )
            return terms, np.array(contacts.numbers)
        sizes = [design_variable(self.document, key) for key in sizes_of(self.mechanism)]
        every = VariedMechanism(self.document, self.mechanism, sizes, self.inputs)
        return every.terms(False), every.nominal

    @property
    def has_gradients(self) -> bool:
        """Whether the kernel knows how figures change with the variables."""
        of_profiles = self.varied.is_profiled and all(
            v.slot is not None or "profiles" in v.path for v in self.variables
        )
        return self.kernel is not None or (of_profiles and not self._masses_follow)

    @property
    def _masses_follow(self) -> bool:
        """Whether figures read masses, which the file states by sizes of links."""
        masses: Mapping[str, Mapping[str, Any]] = self.document.data.get("mass", {})
        follow = any("tensor" not in mass for mass in masses.values())
        return self.figures.read_inertia and follow

    def classes(self, values: Floats) -> NDArray[np.str_] | None:
        """Return the Grashof class of four-bars (variables, n), None for others."""
        places = four_bar_links(self.mechanism)
        if places is None or self.kernel is None:
            return None
        names = [variable.name for variable in self.variables]
        links, arcs = arc_function(
            self.mechanism, names, lambda numbers: design_geometry(self.variables, numbers)
        )
        radians = values * self.varied.scale[:, None]
        lengths = dict(zip(links, arcs(radians), strict=True))
        return class_of(*(lengths[k] for k in places))

    def at(self, values: Floats) -> Evaluated:
        """Return the figures of merit of designs (variables, n), in the file's units."""
        together = BLOCK if self._paths is None else self._followed_together
        parts = [Evaluated.of([], self.figures.names)]
        for start in range(0, values.shape[1], together):
            some = values[:, start : start + together]
            block = self._together(some) if self.kernel else self._one_by_one(some)
            parts.append(replace(block, design=block.design + start))
        return Evaluated.in_order(parts)

    def part(self, count: int) -> int:
        """Return how many of so many designs pay together."""
        if self.kernel is None:
            return SINGLY
        if self._paths is None:
            return PART
        return min(max(FEWEST, count // PARTS), self._followed_together)

    @property
    def is_followed(self) -> bool:
        """Whether all solutions are followed from design to design."""
        return self._paths is not None

    @property
    def _followed_together(self) -> int:
        """How many designs are followed together: what they are on the way stays small."""
        assert self._paths is not None
        per_design = self._paths[1].values.size * len(self.samples.rows)
        return max(1, min(FOLLOWED, ON_THE_WAY // per_design))

    # All designs in one kernel.

    def _together(self, values: Floats) -> Evaluated:
        assert self.kernel is not None
        kernel, names = self.kernel, self.figures.names
        sizes, why = self.varied.sizes(values)
        reason = self._impossible(values)
        reason = np.where(reason == OK, why, reason)
        unlike, possible = np.flatnonzero(reason == UNLIKE), np.flatnonzero(reason == OK)
        lacking = np.flatnonzero((reason != OK) & (reason != UNLIKE))
        parts = [
            Evaluated.of(lacking, names, status=IMPOSSIBLE, reason=reason[lacking]),
            _numbered(self._one_by_one(values[:, unlike]), unlike),
        ]
        if len(possible) and self._paths is None:
            parts.append(_numbered(self._modes(kernel, sizes[:, possible]), possible))
        elif len(possible):
            made, lost = self._followed(kernel, sizes[:, possible], values[:, possible])
            lost = possible[lost]
            parts.append(_numbered(made, possible))
            parts.append(_numbered(self._one_by_one(values[:, lost]), lost))
        return Evaluated.in_order(parts)

    def _impossible(self, values: Floats) -> NDArray[np.object_]:
        """Return why designs (n,) are impossible, OK where they are not."""
        reason = np.full(values.shape[1], OK, dtype=object)
        geometry = self.mechanism.geometry
        for variable, given, scale in zip(
            self.variables, values, self.varied.scale, strict=True
        ):
            if variable.slot is None or variable.slot[0] != "arcs":
                continue
            assert isinstance(geometry, SizeGeometry)
            row, signed = given * scale, geometry.links[variable.slot[1][0]].signed
            outside = ~((row > 0.0) & (row < np.pi)) & (not signed)
            for k in np.flatnonzero(outside & (reason == OK)):
                reason[k] = f"{variable.key} = {given[k]:g}: not between 0 and 180 deg"
        return reason

    def _with_others(self, parts: list[Evaluated], n: int, claim: str) -> Evaluated:
        """Return parts with a row for each of n designs that is in none of them."""
        made = Evaluated.joined([Evaluated.of([], self.figures.names), *parts])
        others = np.setdiff1d(np.arange(n), made.design)
        none = Evaluated.of(
            others, self.figures.names, status=NEVER_CLOSES, reason=NEVER, claim=claim
        )
        return Evaluated.in_order([made, none])

    def _modes(self, kernel: DesignKernel, sizes: Floats) -> Evaluated:
        """Return designs (variables, n) of a kernel in all their modes."""
        n, parts = sizes.shape[1], []
        prepared = kernel.prepare(np.ascontiguousarray(sizes))
        for signs in product((1.0, -1.0), repeat=len(kernel.places)):
            label = "".join("+" if sign > 0 else "-" for sign in signs)
            turns, places = self.turns(kernel, prepared, signs), self.places(signs, n)
            parts.append(self.figures.of(kernel, prepared, places, turns, label, COMPLETE))
        return self._with_others(parts, n, COMPLETE)

    def places(self, signs: Sequence[float], n: int) -> Floats:
        """Return the places (dyads, samples and points, n) of n designs in a mode."""
        shape = len(signs), len(self.figures.rows), n
        return np.broadcast_to(np.reshape(signs, (-1, 1, 1)), shape)

    def _followed(
        self, kernel: DesignKernel, sizes: Floats, of_file: Floats
    ) -> tuple[Evaluated, NDArray[np.intp]]:
        """Return designs (variables, n) in all their modes, and those that got lost.

        `of_file` (variables, n) are their values in the file's units.
        """
        assert self._paths is not None
        claim = COMPLETE if self._paths[1].counted else SAMPLED
        modes, place = self.configurations(sizes)
        prepared = kernel.prepare(np.ascontiguousarray(sizes[:, modes.design]))
        values = modes.values[:, place]
        turns = np.zeros((len(kernel.turning), *values.shape[1:]))
        for design in np.unique(modes.design) if kernel.turning else ():
            here = np.flatnonzero(modes.design == design)
            mechanism = self.kernel_mechanism(of_file[:, design])
            turns[:, :, here] = self.turns_at(kernel, mechanism, values[:, :, here])
        made = self.figures.of(kernel, prepared, values, turns, modes.labels, claim)
        made = _numbered(made, modes.design)
        every = self._with_others([made], sizes.shape[1], claim)
        return every.rows(~np.isin(every.design, modes.lost)), modes.lost

    def configurations(self, sizes: Floats) -> tuple[Modes, NDArray[np.intp]]:
        """Return all modes of designs with the kernel's sizes (k, n), by following.

        And where the samples, then the points of figures, are among their inputs.
        """
        assert self._paths is not None
        lattice, place = self._followed_inputs
        return followed_modes(*self._paths, sizes, lattice), place

    def traced(self, mechanism: Mechanism) -> tuple[Tracer, Motion, Floats]:
        """Return what traced one design, and its motion.

        With the variables (v, samples and points, modes), NaN where a mode does not close.
        """
        lattice, points = self.samples.lattice, self.figures.points
        if lattice.is_path:
            tracer = Tracer(mechanism, self.inputs, path=lattice.q)
        else:
            tracer = Tracer(mechanism, self.inputs, samples=lattice.shape)
        motions = [tracer.motion()]
        if len(points) and len(self.inputs) == 1:
            motions.append(tracer.at(points[:, :1]))
        elif len(points):
            _, place = self._followed_inputs
            motions.append(tracer.samples(place[len(self.samples.rows) :]))
        modes, width = len(tracer.assembly_modes), motions[0].values.shape[1]
        parts = [item.values.reshape(modes, item.samples, width) for item in motions]
        return tracer, motions[0], np.transpose(np.concatenate(parts, axis=1), (2, 1, 0))

    @cached_property
    def _anchor(self) -> Floats:
        """(inputs,) rad, from where turns count."""
        mechanism = self.mechanism.with_inputs(*self.inputs)
        return Solver(mechanism, plan_assembly(mechanism)).unwrapping.anchor

    def turns(
        self, kernel: DesignKernel, prepared: Floats, signs: Sequence[float]
    ) -> Floats:
        """Return the turns (pairs, samples and points, n) of a kernel's pairs in a mode.

        In rad, of designs prepared (k, n), all groups being dyads.
        """
        count, rows = len(self.inputs), self.samples.rows
        contacts = self.varied.contacts
        returns = contacts is None or contacts.train is None
        of_mode = KernelTurns(kernel, prepared, signs, rows.shape[1], self._anchor, returns)
        return of_mode.at(rows[:, :count], self.figures.points[:, :count])

    def kernel_mechanism(self, design: Floats) -> Mechanism:
        """Return the mechanism of a design (variables,) as the kernel has it."""
        mechanism = designed(self.document, self.variables, design.tolist())
        if self.varied.contacts is None:
            return mechanism
        contacts = hinged(mechanism, self.inputs)
        assert contacts is not None
        return contacts.mechanism

    def turns_at(
        self, kernel: DesignKernel, mechanism: Mechanism, values: Floats
    ) -> Floats:
        """Return the turns (pairs, k, modes), rad, of a kernel's pairs.

        Of one mechanism, where its modes have these values (variables, k, modes) in the
        order of samples.
        """
        made = np.zeros((len(kernel.turning), *values.shape[1:]))
        if not kernel.turning:
            return made
        mechanism = mechanism.with_inputs(*self.inputs)
        solver = Solver(mechanism, plan_assembly(mechanism))
        pairs = [mechanism.angles[name] for name in kernel.turning]
        for mode, of_mode in enumerate(np.moveaxis(values, 2, 0)):
            rows = np.flatnonzero(np.all(np.isfinite(of_mode), axis=0))
            at = of_mode[:, rows].T
            turned = solver.unwrapping.turns(mode, at, at[:, solver.driven], pairs)
            made[:, rows, mode] = TURN * turned[:, pairs].T
        return made

    @cached_property
    def _followed_inputs(self) -> tuple[InputGrid, NDArray[np.intp]]:
        """The inputs to follow modes over, and where samples and points are there.

        One input is followed as it grows; several from sample to neighbouring sample, so
        that points are samples.
        """
        lattice, k, points = self.samples.lattice, len(self.inputs), self.figures.points
        if k == 1:
            every = np.concatenate([lattice.q[:, 0], points[:, 0]])
            q, place = np.unique(every, return_inverse=True)
            return InputGrid(q[:, None], (len(q),)), place
        rows = list(range(len(lattice)))
        for point in points[:, :k]:
            away = np.max(np.abs(lattice.q - point), axis=1)
            rows.append(int(np.argmin(away)))
            if np.min(away) > SAME_INPUT:
                inputs = ", ".join(f"{angle:.6g}" for angle in point)
                raise DesignError(
                    f"{self.mechanism.name}: at inputs {inputs} rad: with several inputs "
                    "and groups beyond dyads figures are those at samples; choose one"
                )
        return lattice, np.array(rows)

    # One design after the other.

    def _one_by_one(self, values: Floats) -> Evaluated:
        parts = [Evaluated.of([], self.figures.names)]
        for k, design in enumerate(values.T):
            try:
                of_design = self._single(designed(self.document, self.variables, design))
            except SpherekitError as problem:
                of_design = refused(problem, self.figures.names)
            parts.append(replace(of_design, design=of_design.design + k))
        return Evaluated.in_order(parts)

    def _single(self, mechanism: Mechanism) -> Evaluated:
        assembly = plan_assembly(mechanism.with_inputs(*self.inputs))
        if assembly.has_closed_form:
            terms = DesignTerms.of(mechanism, self.inputs)
            kernel = design_kernel(terms, self.figures.columns, compiled=False)
            return self._modes(kernel, np.empty((0, 1)))
        tracer, motion, values = self.traced(mechanism)
        profiled = self.varied.is_profiled
        terms = DesignTerms.of(
            mechanism,
            self.inputs,
            geometry=lambda _: turning_pairs(mechanism, as_columns=profiled),
            closed=motion,
        )
        kernel = design_kernel(terms, self.figures.columns, compiled=False)
        modes, claim = tracer.assembly_modes, tracer.claim.guarantee.value
        made = self.figures.of(
            kernel,
            kernel.prepare(np.empty((0, len(modes)))),
            values,
            self.turns_at(kernel, mechanism, values),
            [f"{mode.number} {mode.label}" for mode in modes],
            claim,
            tracks_of(mechanism) if profiled else (),
        )
        return self._with_others([replace(made, design=0 * made.design)], 1, claim)


def _numbered(made: Evaluated, numbers: NDArray[np.intp]) -> Evaluated:
    """Return rows whose designs have these numbers among others."""
    return replace(made, design=numbers[made.design])
