"""Figures of merit of designs: by a kernel for all of them at once, or one by one."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import product
from typing import Any, final

import numpy as np
from numpy.typing import NDArray

from spherekit.analysis.merit import Merit
from spherekit.conventions import TURN
from spherekit.design.all_solutions import StartSet, start_set
from spherekit.design.at_samples import BLOCK, at_modes, at_variables, in_mode
from spherekit.design.evaluated import (
    IMPOSSIBLE,
    NEVER,
    NEVER_CLOSES,
    Evaluated,
    none,
    refused,
    without,
)
from spherekit.design.file_numbers import OK, UNLIKE, FileNumbers
from spherekit.design.followed_modes import Modes, followed_modes
from spherekit.design.kernel_turns import KernelTurns
from spherekit.design.profile_numbers import ProfileNumbers, has_other_profiles, tracks_of
from spherekit.design.samples import DesignSamples
from spherekit.design.size_keys import sizes_of
from spherekit.design.taken_figures import TakenFigures
from spherekit.design.variables import (
    ACTIONS,
    DesignVariable,
    design_geometry,
    design_variable,
    designed,
    designed_pairs,
)
from spherekit.engine.design_kernel import (
    DesignKernel,
    DesignTerms,
    arc_function,
    design_kernel,
)
from spherekit.engine.hinges import hinged
from spherekit.engine.path_kernel import PathKernel, path_kernel
from spherekit.engine.turns import TurningPairs, turning_pairs
from spherekit.errors import DesignError, SpherekitError
from spherekit.files.document import Document
from spherekit.guarantee import Guarantee
from spherekit.model.actions import need_tabulated
from spherekit.model.mechanism import Mechanism
from spherekit.model.parts import SizeGeometry
from spherekit.motion.assembly_modes import Solver
from spherekit.motion.continued import AngleMemory
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
DEG = np.pi / 180.0


@final
@dataclass(frozen=True)
class DesignAt:
    """What kernels have of a design.

    `values` (variables,) in the file's units, `sizes` (k,) in rad and SI with their
    derivatives `slopes` (k, variables) by the values, and profiles that are handed in.
    """

    values: Floats
    sizes: Floats
    slopes: Floats
    profiles: ProfileNumbers | None


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
        self.document = document
        self.mechanism = mechanism
        self.inputs = samples.inputs
        self.variables = tuple(variables)
        self.merits = tuple(merits)
        self.samples = samples
        self.figures = TakenFigures(mechanism, self.merits, samples)
        if any(name.startswith("torque") for name in self.figures.columns):
            need_tabulated(mechanism, samples.rows[:, -1])
        self._paths: tuple[PathKernel, StartSet] | None = None
        self.numbers: FileNumbers | None = None
        self.kernel = self._kernel()

    def _kernel(self) -> DesignKernel | None:
        """Return the kernel of all designs, None where they have none."""
        contacts = None
        if self.mechanism.has_contacts:
            contacts = hinged(self.mechanism, self.inputs)
            if contacts is None:
                return None
        elif any(v.slot is None and v.path[0] not in ACTIONS for v in self.variables):
            return None
        following = self.figures.read_inertia and self._masses_follow()
        acting = any(v.path[0] in ACTIONS for v in self.variables)
        if acting or following or contacts:
            self.numbers = FileNumbers(
                self.document,
                self.mechanism,
                self.variables,
                self.inputs,
                contacts,
                following,
            )
        terms = self.terms()
        if terms.closed_form:
            return design_kernel(terms, self.figures.columns)
        paths = path_kernel(terms)
        start = start_set(paths, self._nominal, *self._every_size())
        if start is None:
            self.numbers = None
            return None
        self._paths = paths, start
        return design_kernel(terms, self.figures.columns)

    def terms(self, closed_form: bool | None = None) -> DesignTerms:
        """Return what kernels of all designs are written in."""
        names = [variable.name for variable in self.variables]
        if self.is_profiled:
            return self._profiled_terms()
        if self.numbers is None:
            return DesignTerms.of(
                self.mechanism, self.inputs, names, self._designed, closed_form
            )
        contacts, read = self.numbers.hinged, self.numbers.of_contacts
        if contacts is None:
            return DesignTerms.of(
                self.mechanism,
                self.inputs,
                names,
                self._designed,
                closed_form,
                self.numbers.of_actions,
            )
        angles = {k: f"turned_{k}" for k in read}
        return DesignTerms.of(
            contacts.mechanism,
            self.inputs,
            [*names, *angles.values()],
            lambda numbers: contacts.pairs({k: numbers[n] for k, n in angles.items()}),
            closed_form,
            self.numbers.of_actions,
        )

    def _profiled_terms(self) -> DesignTerms:
        """Return the terms in which profiles are handed in."""
        chosen = [self.variables[k] for k in self.sized]
        return DesignTerms.of(
            self.mechanism,
            self.inputs,
            [variable.name for variable in chosen],
            lambda numbers: designed_pairs(self.mechanism, chosen, numbers, True),
            closed_form=False,
        )

    @cached_property
    def sized(self) -> list[int]:
        """Which variables are sizes of the kernel, not numbers of profiles."""
        return [k for k, v in enumerate(self.variables) if v.slot is not None]

    @property
    def _nominal(self) -> Floats:
        """The sizes of the kernel (k,) in the file."""
        sizes = self.radians(np.array([[v.value] for v in self.variables]))[:, 0]
        if self.numbers is None:
            return sizes
        read = np.array(self.numbers.nominal)[list(self.numbers.differing)]
        return np.concatenate([sizes, read])

    def _every_size(self) -> tuple[DesignTerms, Floats]:
        """Return terms of all sizes of the mechanism, and what these are in the file."""
        contacts = self.numbers.hinged if self.numbers else None
        if contacts is not None:
            names = [f"turned_{k}" for k in range(len(contacts.numbers))]
            terms = DesignTerms.of(
                contacts.mechanism,
                self.inputs,
                names,
                lambda numbers: contacts.pairs(dict(enumerate(numbers.values()))),
                closed_form=False,
            )
            return terms, np.array(contacts.numbers)
        every = [design_variable(self.document, key) for key in sizes_of(self.mechanism)]
        terms = DesignTerms.of(
            self.mechanism,
            self.inputs,
            [variable.name for variable in every],
            lambda numbers: designed_pairs(self.mechanism, every, numbers),
            closed_form=False,
        )
        unit = DEG if self.document.data["angle_unit"] == "deg" else 1.0
        return terms, unit * np.array([variable.value for variable in every])

    def _designed(self, numbers: Mapping[str, Any]) -> TurningPairs:
        return designed_pairs(self.mechanism, self.variables, numbers)

    def design_at(self, values: Floats) -> DesignAt | None:
        """Return what the kernel has of a design (variables,), None if there is none."""
        inputs = self.inputs_at(values)
        if inputs is None:
            return None
        profiles = None
        if self.is_profiled:
            try:
                profiles = ProfileNumbers.of_design(self.document, self.variables, values)
            except SpherekitError:
                return None
        return DesignAt(values, *inputs, profiles)

    @cached_property
    def is_profiled(self) -> bool:
        """Whether profiles are no circles, and what they are is handed in."""
        return has_other_profiles(self.mechanism)

    @property
    def has_gradients(self) -> bool:
        """Whether the kernel knows how figures change with the variables."""
        if self.kernel is not None:
            return True
        inertial = self.figures.read_inertia
        return (
            self.is_profiled
            and all(v.slot is not None or "profiles" in v.path for v in self.variables)
            and not (inertial and self._masses_follow())
        )

    def inputs_at(self, values: Floats) -> tuple[Floats, Floats] | None:
        """Return the kernel's sizes of a design (variables,) and their derivatives.

        (sizes,) in rad and SI and (sizes, variables) by its numbers in the file's units;
        None if there is no such design.
        """
        sizes = self.radians(values[:, None])[:, 0]
        scale = np.diag(self.radians(np.ones((len(values), 1)))[:, 0])
        if self.is_profiled:
            return sizes[self.sized], scale[self.sized]
        if self.numbers is None:
            return sizes, scale
        numbers, why = self.numbers.at(values[:, None])
        if why[0] != OK:
            return None
        slopes = self.numbers.slopes(values)
        return np.concatenate([sizes, numbers[:, 0]]), np.vstack([scale, slopes])

    def _masses_follow(self) -> bool:
        """Return whether the file states masses by sizes of links, which then follow."""
        masses: Mapping[str, Mapping[str, Any]] = self.document.data.get("mass", {})
        return any("tensor" not in mass for mass in masses.values())

    def radians(self, values: Floats) -> Floats:
        """Return values (variables, n) in the file's units in rad and SI."""
        unit = DEG if self.document.data["angle_unit"] == "deg" else 1.0
        scale = [unit if variable.is_angle else 1.0 for variable in self.variables]
        return np.asarray(values * np.array(scale)[:, None])

    def classes(self, values: Floats) -> NDArray[np.str_] | None:
        """Return the Grashof class of four-bars (variables, n), None for others."""
        places = four_bar_links(self.mechanism)
        if places is None or self.kernel is None:
            return None
        names = [variable.name for variable in self.variables]
        links, arcs = arc_function(
            self.mechanism, names, lambda numbers: design_geometry(self.variables, numbers)
        )
        lengths = dict(zip(links, arcs(self.radians(values)), strict=True))
        return class_of(*(lengths[k] for k in places))

    def at(self, values: Floats) -> Evaluated:
        """Return the figures of merit of designs (variables, n), in the file's units."""
        parts = [none(self.merits)]
        together = BLOCK if self._paths is None else self._followed_together
        for start in range(0, values.shape[1], together):
            some = values[:, start : start + together]
            block = self._together(some) if self.kernel else self._one_by_one(some)
            parts.append(replace(block, design=block.design + start))
        return self._joined(parts)

    def _joined(self, parts: Sequence[Evaluated]) -> Evaluated:
        return Evaluated.joined(parts, [merit.name for merit in self.merits])

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
        sizes = self.radians(values)
        reason = self._impossible(values, sizes)
        parts = []
        if self.numbers is not None:
            numbers, why = self.numbers.at(values)
            sizes = np.concatenate([sizes, numbers])
            reason = np.where(reason == OK, why, reason)
            unlike = np.flatnonzero(reason == UNLIKE)
            singly = self._one_by_one(values[:, unlike])
            parts.append(replace(singly, design=unlike[singly.design]))
        possible = np.flatnonzero(reason == OK)
        lacking = np.flatnonzero((reason != OK) & (reason != UNLIKE))
        parts.append(without(lacking, IMPOSSIBLE, reason[lacking], self.merits))
        if len(possible) and self._paths is None:
            closed = self._modes(self.kernel, sizes[:, possible])
            parts.append(replace(closed, design=possible[closed.design]))
        elif len(possible):
            parted = sizes[:, possible], values[:, possible]
            followed, lost = self._followed(self.kernel, *parted)
            parts.append(replace(followed, design=possible[followed.design]))
            singly = self._one_by_one(values[:, possible[lost]])
            parts.append(replace(singly, design=possible[lost[singly.design]]))
        return self._joined(parts)

    def _impossible(self, values: Floats, sizes: Floats) -> NDArray[np.object_]:
        """Return why designs (n,) are impossible, OK where they are not."""
        reason = np.full(values.shape[1], OK, dtype=object)
        for variable, row, given in zip(self.variables, sizes, values, strict=True):
            if variable.slot is None or variable.slot[0] != "arcs":
                continue
            outside = ~((row > 0.0) & (row < np.pi)) & ~_signed(self.mechanism, variable)
            for k in np.flatnonzero(outside & (reason == OK)):
                reason[k] = f"{variable.key} = {given[k]:g}: not between 0 and 180 deg"
        return reason

    def _modes(self, kernel: DesignKernel, sizes: Floats) -> Evaluated:
        """Return designs (variables, n) of a kernel in all their modes."""
        n = sizes.shape[1]
        prepared = kernel.prepare(np.ascontiguousarray(sizes))
        parts, closing = [], np.zeros(n, dtype=bool)
        for signs in product((1.0, -1.0), repeat=len(kernel.places)):
            reducing, points = self.figures.reducing(n), self.figures.points()
            turns, there = self.turns(kernel, prepared, signs)
            closes = np.zeros(n)
            with np.errstate(all="ignore"):
                for sample, columns, closed in in_mode(
                    kernel, prepared, signs, self.samples.rows, turns
                ):
                    closes += closed
                    self.figures.take(reducing, sample, columns, closed)
                for sample, columns, closed in in_mode(
                    kernel, prepared, signs, points, there
                ):
                    self.figures.take(reducing, sample, columns, closed, True)
            label = "".join("+" if sign > 0 else "-" for sign in signs)
            rows = np.flatnonzero(closes > 0)
            parts.append(self.figures.rows(rows, [label] * n, closes, reducing, COMPLETE))
            closing |= closes > 0
        never = np.flatnonzero(~closing)
        parts.append(without(never, NEVER_CLOSES, NEVER, self.merits, COMPLETE))
        return self._joined(parts)

    def _followed(
        self, kernel: DesignKernel, sizes: Floats, of_file: Floats
    ) -> tuple[Evaluated, NDArray[np.intp]]:
        """Return designs (variables, n) in all their modes, and those that got lost.

        `of_file` (variables, n) are their values in the file's units.
        """
        assert self._paths is not None
        _, start = self._paths
        samples, points = self.samples.rows, self.figures.points()
        modes, place = self.configurations(sizes)
        prepared = kernel.prepare(np.ascontiguousarray(sizes[:, modes.design]))
        values = modes.values[:, place]
        count, k = len(modes.design), len(samples)
        reducing = self.figures.reducing(count)
        turns = np.zeros((len(kernel.turning), values.shape[1], count))
        for design in np.unique(modes.design) if kernel.turning else ():
            here = np.flatnonzero(modes.design == design)
            of_design = of_file[:, design], values[:, :, here]
            turns[:, :, here] = self.turns_at(kernel, *of_design)
        closes = np.zeros(count)
        with np.errstate(all="ignore"):
            for sample, columns, closed in at_modes(
                kernel, prepared, values, samples, turns
            ):
                closes += closed
                self.figures.take(reducing, sample, columns, closed)
            for sample, columns, closed in at_modes(
                kernel, prepared, values[:, k:], points, turns[:, k:]
            ):
                self.figures.take(reducing, sample, columns, closed, True)
        rows = np.flatnonzero(closes > 0)
        claim = COMPLETE if start.counted else SAMPLED
        made = self.figures.rows(rows, modes.labels, closes, reducing, claim)
        made = replace(made, design=modes.design[made.design])
        others = np.setdiff1d(np.arange(sizes.shape[1]), [*modes.lost, *made.design])
        nowhere = without(others, NEVER_CLOSES, NEVER, self.merits, claim)
        return self._joined([made, nowhere]), modes.lost

    def configurations(self, sizes: Floats) -> tuple[Modes, NDArray[np.intp]]:
        """Return all modes of designs with the kernel's sizes (k, n), by following.

        And where the samples, then the points of figures, are among their inputs.
        """
        assert self._paths is not None
        lattice, place = self._followed_inputs(self.figures.points())
        return followed_modes(*self._paths, sizes, lattice), place

    def traced(self, mechanism: Mechanism) -> tuple[Tracer, Motion, Motion | None]:
        """Return what traced one design, its motion, and that at the points of figures."""
        tracer = self._tracer(mechanism)
        motion, points = tracer.motion(), self.figures.points()
        if not len(points):
            return tracer, motion, None
        if len(self.inputs) == 1:
            return tracer, motion, tracer.at(points[:, :1])
        _, place = self._followed_inputs(points)
        return tracer, motion, tracer.samples(place[len(self.samples.rows) :])

    @cached_property
    def _anchor(self) -> Floats:
        """(inputs,) rad, from where turns count."""
        mechanism = self.mechanism.with_inputs(*self.inputs)
        return Solver(mechanism, plan_assembly(mechanism)).unwrapping.anchor

    def turns(
        self, kernel: DesignKernel, prepared: Floats, signs: Sequence[float]
    ) -> tuple[Floats, Floats]:
        """Return the turns of a kernel's pairs in a mode, at samples and at points.

        (pairs, samples, n) and (pairs, points, n), rad, of designs prepared (k, n), all
        groups being dyads.
        """
        count, samples = len(self.inputs), self.samples.rows
        where = samples[:, :count], self.figures.points()[:, :count]
        contacts = self.numbers.hinged if self.numbers else None
        returns = contacts is None or contacts.train is None
        of_mode = KernelTurns(
            kernel, prepared, signs, samples.shape[1], self._anchor, returns
        )
        return of_mode.at(*where)

    def turns_at(self, kernel: DesignKernel, design: Floats, values: Floats) -> Floats:
        """Return the turns (pairs, k, modes), rad, of a kernel's pairs.

        Of a design (variables,), in the file's units, where its modes have these values
        (variables, k, modes) in the order of samples.
        """
        mechanism = designed(self.document, self.variables, design.tolist())
        if self.numbers is not None and self.numbers.hinged is not None:
            contacts = hinged(mechanism, self.inputs)
            assert contacts is not None
            mechanism = contacts.mechanism
        mechanism = mechanism.with_inputs(*self.inputs)
        solver = Solver(mechanism, plan_assembly(mechanism))
        made = np.zeros((len(kernel.turning), *values.shape[1:]))
        pairs = [mechanism.angles[name] for name in kernel.turning]
        for mode, of_mode in enumerate(np.moveaxis(values, 2, 0)):
            rows = np.flatnonzero(np.all(np.isfinite(of_mode), axis=0))
            at = of_mode[:, rows].T
            turned = solver.unwrapping.turns(mode, at, at[:, solver.driven], pairs)
            made[:, rows, mode] = TURN * turned[:, pairs].T
        return made

    def _followed_inputs(self, points: Floats) -> tuple[InputGrid, NDArray[np.intp]]:
        """Return the inputs to follow modes over, and where samples and points are there.

        One input is followed as it grows; several from sample to neighbouring sample, so
        that points are samples.
        """
        lattice, k = self.samples.lattice, len(self.inputs)
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
        parts = [none(self.merits)]
        for k, design in enumerate(values.T):
            try:
                of_design = self._single(designed(self.document, self.variables, design))
            except SpherekitError as problem:
                of_design = refused(problem, self.merits)
            parts.append(replace(of_design, design=of_design.design + k))
        return self._joined(parts)

    def _single(self, mechanism: Mechanism) -> Evaluated:
        assembly = plan_assembly(mechanism.with_inputs(*self.inputs))
        if assembly.has_closed_form:
            terms = DesignTerms.of(mechanism, self.inputs)
            kernel = design_kernel(terms, self.figures.columns, compiled=False)
            return self._modes(kernel, np.empty((0, 1)))
        rows, points = self.samples.rows, self.figures.points()
        tracer, motion, there = self.traced(mechanism)
        profiled = has_other_profiles(mechanism)
        terms = DesignTerms.of(
            mechanism,
            self.inputs,
            geometry=lambda _: turning_pairs(mechanism, as_columns=profiled),
            closed=motion,
        )
        tracks = tracks_of(mechanism) if profiled else ()
        kernel = design_kernel(terms, self.figures.columns, compiled=False)
        modes = tracer.assembly_modes
        count = len(modes)
        reducing = self.figures.reducing(count)
        closes = np.zeros(count)
        with np.errstate(all="ignore"):
            for sample, columns, closed in at_variables(
                kernel, motion, rows, tracks, _turns_of(kernel, motion, tracer)
            ):
                closes += closed
                self.figures.take(reducing, sample, columns, closed)
            if there is not None:
                for sample, columns, closed in at_variables(
                    kernel, there, points, tracks, _turns_of(kernel, there, tracer)
                ):
                    self.figures.take(reducing, sample, columns, closed, True)
        claim = tracer.claim.guarantee.value
        if not np.any(closes):
            one = np.zeros(1, dtype=np.int64)
            return without(one, NEVER_CLOSES, NEVER, self.merits, claim)
        labels = [f"{mode.number} {mode.label}" for mode in modes]
        some = np.flatnonzero(closes > 0)
        made = self.figures.rows(some, labels, closes, reducing, claim)
        return replace(made, design=np.zeros_like(made.design))

    def _tracer(self, mechanism: Mechanism) -> Tracer:
        lattice = self.samples.lattice
        if lattice.is_path:
            return Tracer(mechanism, self.inputs, path=lattice.q)
        return Tracer(mechanism, self.inputs, samples=lattice.shape)


def _turns_of(kernel: DesignKernel, motion: Motion, tracer: Tracer) -> Floats:
    """Return the turns (pairs, samples, modes), rad, of a kernel's pairs in a motion."""
    angles = motion.mechanism.angles
    going_on = AngleMemory().continued(motion, kernel.turning, tracer.solver)
    every = [going_on[pair] - motion.values[:, angles[pair]] for pair in kernel.turning]
    shape = len(every), len(motion.assembly_modes), motion.samples
    return np.swapaxes(np.reshape(every, shape), 1, 2)


def _signed(mechanism: Mechanism, variable: DesignVariable) -> bool:
    """Return whether the file lets an arc run beyond half a turn."""
    assert isinstance(mechanism.geometry, SizeGeometry) and variable.slot is not None
    return mechanism.geometry.links[variable.slot[1][0]].signed
