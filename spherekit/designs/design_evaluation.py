"""Figures of merit of designs: by a kernel for all of them at once, or one by one.

Turns of the pairs of a kernel in closed form: by the rule of `positions.angle_unwrapping`.

Angles of all designs are followed at once, between inputs so near that none moves far.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cached_property
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray

from spherekit.arrays import Floats, Indices
from spherekit.completeness import Guarantee
from spherekit.conventions import TURN, Names
from spherekit.designs.design_kernel import DesignKernel, RedundantKernel, arc_function
from spherekit.designs.design_variables import ACTIONS, OK, DesignVariable, designed
from spherekit.designs.figures_of_merit import (
    BLOCK,
    IMPOSSIBLE,
    INERTIAL,
    NEVER,
    NEVER_CLOSES,
    DesignSamples,
    Evaluated,
    KernelFigures,
    refused,
)
from spherekit.designs.homotopy import StartSolutions, start_set
from spherekit.designs.mode_tracking import followed_modes
from spherekit.designs.path_kernel import PathKernel
from spherekit.designs.profile_numbers import tracks_of
from spherekit.designs.varied_mechanism import UNLIKE, VariedMechanism
from spherekit.errors import CountError, DesignError, SpherekitError
from spherekit.files.toml_document import Document
from spherekit.geometry.vectors import all_finite, max_abs
from spherekit.mechanism.elements import SizeGeometry
from spherekit.mechanism.load_dependence import need_tabulated
from spherekit.mechanism.mechanism import Mechanism
from spherekit.numerics.angles import wrap
from spherekit.planning.assembly_plan import plan_assembly
from spherekit.positions.angle_unwrapping import AngleUnwrapping, count_revolutions
from spherekit.positions.input_grid import InputGrid
from spherekit.positions.motion import Motion
from spherekit.positions.position_analysis import PositionAnalysis
from spherekit.positions.position_solver import PositionSolver
from spherekit.runs.figure_of_merit import FigureOfMerit
from spherekit.singularities.grashof import class_of, four_bar_links
from spherekit.velocities.axis_rotations import pair_rotations
from spherekit.velocities.design_expressions import DesignExpressions
from spherekit.velocities.equivalent_linkage import find_equivalent_linkage
from spherekit.velocities.load_numbers import LOAD_DEPENDENT_PREFIXES
from spherekit.wording import listing

STRIDE = np.radians(3.0)
"""Inputs at which angles are looked at are nearer (rad) than this."""
SWING = 1.0
"""Where an angle moves by more (rad) between two, it is looked at between them."""
HALVINGS = 12
"""How often at most; an angle that moves as far even then is not followed there."""
EDGE = 30
"""Halvings that lead to the end of an assembly mode."""

TOGETHER = 16384
"""Rows that are looked at together: they stay in the cache."""


Angles = Callable[[Indices, Floats], Floats]
"""Angles (pairs, m) of designs (m,) at inputs (m, inputs), NaN where they do not close."""


def _along(angles: Angles, n: int, q: Floats) -> tuple[Floats, Floats]:
    """Return the angles (pairs, k, n) of all designs at inputs (k, inputs).

    And by how much they grow (pairs, k - 1, n) to the next.
    """
    who = np.tile(np.arange(n), len(q))
    rows = np.repeat(q, n, axis=0)
    at = angles(who, rows)
    steps = _grown(angles, who[n:], (rows[:-n], rows[n:]), (at[:, :-n], at[:, n:]))
    return at.reshape(len(at), -1, n), steps.reshape(len(at), -1, n)


def _grown(
    angles: Angles,
    who: Indices,
    inputs: tuple[Floats, Floats],
    ends: tuple[Floats, Floats],
    halvings: int = HALVINGS,
) -> Floats:
    """Return by how much angles of designs (m,) grow from inputs to others.

    NaN where they are not followed.
    """
    step = wrap(ends[1] - ends[0])
    far = np.flatnonzero(max_abs(step, axis=0) > SWING)
    step[:, far] = np.nan
    if len(far) and halvings:
        low, high = (q[far] for q in inputs)
        first, last = (end[:, far] for end in ends)
        between = 0.5 * (low + high)
        here = angles(who[far], between)
        parts = ((low, between), (first, here)), ((between, high), (here, last))
        step[:, far] = sum(_grown(angles, who[far], *x, halvings - 1) for x in parts)
    return step


def turns_along_one(
    angles: Angles, n: int, anchor: float, q: Floats, returns: bool
) -> Floats:
    """Return turns (pairs, k, n), rad, to be added to the angles of n designs.

    At values (k,) of a single input that goes on from an anchor; one that `returns` has
    come back to where it was after a turn.
    """
    laps = np.floor((q - anchor) / TURN) * returns
    place = q - laps * TURN
    ends = [anchor, *place, *[anchor + TURN] * returns]
    fill = np.linspace(min(ends), max(ends), 2 + int(np.ptp(ends) / STRIDE))
    stations = np.unique([*ends, *fill])
    there, steps = _along(angles, n, stations[:, None])
    start = np.searchsorted(stations, anchor)
    whole = np.empty_like(there)
    for way, along in (
        (slice(start, None), steps[:, start:]),
        (slice(start, None, -1), -steps[:, :start][:, ::-1]),
    ):
        whole[:, way] = _followed(angles, stations[way], there[:, way], along)
    grown = np.zeros_like(whole[:, 0])
    if returns:
        grown = np.round((whole[:, -1] - whole[:, 0]) / TURN) * TURN
        # A mode that ends goes on to either side of the anchor.
        last = np.isfinite(np.cumsum(steps[0, ::-1], axis=0))[::-1]
        whole[:, :-1] -= np.where(last & ~last[0], grown[:, None], 0.0)
        grown = np.where(last[0], grown, 0.0)
        whole[:, -1] = whole[:, 0] + grown
    at = np.searchsorted(stations, place)
    return np.nan_to_num(whole[:, at] + laps[:, None] * grown[:, None] - there[:, at])


def _followed(angles: Angles, stations: Floats, there: Floats, steps: Floats) -> Floats:
    """Return angles (pairs, k, n) that go on from the first, or from a mode's end."""
    whole = there - TURN * count_revolutions(there)
    for k in range(1, len(stations)):
        onward = whole[:, k - 1] + steps[:, k - 1]
        who = np.flatnonzero(np.isnan(onward[0]) & np.isfinite(there[0, k]))
        if len(who):
            onward[:, who] = _begun(angles, who, stations[k - 1 : k + 1], there[:, k, who])
        whole[:, k] = onward
    return whole


def _begun(angles: Angles, who: Indices, ends: Floats, last: Floats) -> Floats:
    """Return angles (pairs, m) that begin in (-pi, pi] where a mode does.

    It has the `last` at the second of two inputs (2,), and is not at the first.
    """
    open_, closed = (np.full((len(who), 1), end) for end in ends)
    at = closed
    first = last
    for _ in range(EDGE):
        between = 0.5 * (open_ + at)
        here = angles(who, between)
        inside = np.isfinite(here[0])
        at = np.where(inside[:, None], between, at)
        open_ = np.where(inside[:, None], open_, between)
        first = np.where(inside, here, first)
    grown = np.nan_to_num(_grown(angles, who, (at, closed), (first, last)))
    return first - TURN * count_revolutions(first) + grown


def turns_along_several(
    angles: Angles, n: int, anchor: Floats, q: Floats, points: Floats
) -> Floats:
    """Return turns (pairs, k + m, n), rad, to be added to the angles of n designs.

    At samples (k, inputs), each from the one before on, the first from an `anchor`
    (inputs,); then at points (m, inputs), each from the nearest sample on. Or from the
    anchor, where these do not lead there; angles are in (-pi, pi] where neither does.
    """
    every = np.concatenate([q, points])
    origins = [*range(-1, len(q) - 1)]
    origins += [int(np.argmin(max_abs(q - point, axis=1))) for point in points]
    home = -TURN * count_revolutions(angles(np.arange(n), np.tile(anchor, (n, 1))))
    turns = np.zeros((len(home), len(every), n))
    for k, (there, origin) in enumerate(zip(every, origins, strict=True)):
        made = np.full_like(home, np.nan)
        before = (every[origin], turns[:, origin]) if k else (anchor, home)
        for begin, turned in (before, (anchor, home)):
            way = np.linspace(begin, there, 2 + int(max_abs(there - begin) / STRIDE))
            at, steps = _along(angles, n, way)
            turned = turned + np.sum(steps, axis=1) - (at[:, -1] - at[:, 0])
            made = np.where(np.isnan(made), turned, made)
            if not np.any(np.isnan(made) & np.isfinite(at[:, -1])):
                break
        made = np.where(np.isnan(made), -TURN * count_revolutions(at[:, -1]), made)
        turns[:, k] = np.nan_to_num(TURN * np.round(made / TURN))
    return turns


PART = 16384
FOLLOWED = 768
SINGLY = 16
"""Designs in a part: in closed form, followed, and one by one."""

FEWEST = 256
PARTS = 8
"""Designs that are followed in a part at least, and parts that are made of more."""

HELD = 2**24
"""Values of figures at samples that are held together."""

ON_THE_WAY = 2**25
"""Variables of all solutions of designs that are followed together, at all samples."""

COMPLETE = Guarantee.COMPLETE.value
SAMPLED = Guarantee.SAMPLED.value

SAME_INPUT = 1e-9
"""Inputs (rad) that differ by less are those of one sample."""


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
        merits: Sequence[FigureOfMerit],
        samples: DesignSamples,
    ) -> None:
        self.document, self.mechanism, self.inputs = document, mechanism, samples.inputs
        self.variables, self.samples = tuple(variables), samples
        self.figures = KernelFigures(mechanism, merits, samples)
        if any(name.startswith(LOAD_DEPENDENT_PREFIXES) for name in self.figures.columns):
            need_tabulated(mechanism, samples.rows[:, -1])
        contacts = find_equivalent_linkage(mechanism, self.inputs)
        self.varied = VariedMechanism(
            document, mechanism, self.variables, self.inputs, contacts, self._masses_follow
        )
        self._paths: tuple[PathKernel, StartSolutions] | None = None
        self.kernel = self._kernel()

    def _kernel(self) -> DesignKernel | None:
        """Return the kernel of all designs, None where they have none.

        Modes that follow smooth curves through crossings have none: their signs change at
        inputs that differ from design to design. Where constraints repeat each other, the
        equations of a kernel close some loops only, and others stay open in designs whose
        sizes do not agree. So each of these designs is searched by itself, as a run does.
        """
        if self.samples.crossings == "pass" or self._is_over_constrained:
            return None
        if self.mechanism.has_contacts:
            if self.varied.contacts is None or self.varied.points:
                return None
        elif any(v.slot is None and v.path[0] not in ACTIONS for v in self.variables):
            return None
        terms = self.varied.terms()
        if not terms.has_closed_form:
            paths = PathKernel(terms)
            start = start_set(paths, self.varied.nominal)
            if start is None:
                return None
            self._paths = paths, start
        return DesignKernel(terms, self.figures.columns)

    @cached_property
    def _is_over_constrained(self) -> bool:
        """Whether counting leaves fewer degrees of freedom than the designs have inputs."""
        try:
            plan_assembly(self.mechanism.with_inputs(*self.inputs))
        except CountError:
            return True
        return False

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
        masses = self.document.data.get("mass", {})
        return any("tensor" not in mass for mass in masses.values()) and any(
            name.startswith(INERTIAL) for name in self.figures.columns
        )

    def classes(self, values: Floats) -> NDArray[np.str_] | None:
        """Return the Grashof class of four-bars (variables, n), None for others."""
        places = four_bar_links(self.mechanism)
        if places is None or self.kernel is None:
            return None
        links, arcs = arc_function(self.varied.terms())
        of_links = (values * self.varied.scale[:, None])[self.varied.sized]
        others = len(self.varied.nominal) - len(of_links)  # no arc is one of them
        sizes = np.pad(of_links, ((0, others), (0, 0)))
        lengths = dict(zip(links, arcs(sizes), strict=True))
        return class_of(*(lengths[k] for k in places))

    def at(self, values: Floats) -> Evaluated:
        """Return the figures of merit of designs (variables, n), in the file's units."""
        held = HELD // (len(self.figures.merits) * len(self.figures.rows))
        together = min(BLOCK, held + 1) if self._paths is None else self._followed_together
        parts = []
        for start in range(0, values.shape[1], together):
            some = values[:, start : start + together]
            made = self._together(self.kernel, some) if self.kernel else self._singly(some)
            parts.append(replace(made, design=made.design + start))
        return Evaluated.in_order(parts, self.figures.names)

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
    def follows_modes(self) -> bool:
        """Whether modes are told by their configurations, and have no signs."""
        return self.is_followed or self.varied.is_profiled

    @cached_property
    def newton(self) -> PathKernel:
        """Newton's step alone, by which configurations follow to other designs."""
        return PathKernel(self.varied.terms())

    @property
    def _followed_together(self) -> int:
        """How many designs are followed together: what they are on the way stays small."""
        assert self._paths is not None
        per_design = self._paths[1].values.size * len(self.samples.rows)
        return max(1, min(FOLLOWED, ON_THE_WAY // per_design))

    # All designs in one kernel.

    def _together(self, kernel: DesignKernel, values: Floats) -> Evaluated:
        names = self.figures.names
        sizes, reason = self.varied.sizes(values)
        self._judge_arcs(values, reason)
        singly = np.flatnonzero(reason == UNLIKE)
        possible = np.flatnonzero(reason == OK)
        lacking = np.flatnonzero((reason != OK) & (reason != UNLIKE))
        parts = [Evaluated.of(lacking, names, status=IMPOSSIBLE, reason=reason[lacking])]
        if len(possible):
            if self._paths is None:
                made = self._modes(kernel, sizes[:, possible])
            else:
                made, lost = self._followed(kernel, sizes[:, possible], values[:, possible])
                singly = np.append(singly, possible[lost])
            parts.append(_numbered(made, possible))
        parts.append(_numbered(self._singly(values[:, singly]), singly))
        return Evaluated.in_order(parts, names)

    def _judge_arcs(self, values: Floats, reason: NDArray[np.object_]) -> None:
        """Say of designs (variables, n) which arcs are impossible."""
        geometry = self.mechanism.geometry
        scales = self.varied.scale
        for variable, given, scale in zip(self.variables, values, scales, strict=True):
            match variable.slot:
                case ("arcs", (link, _)) if isinstance(geometry, SizeGeometry):
                    outside = ~((given > 0.0) & (given * scale < np.pi))
                    for k in np.flatnonzero(outside & (not geometry.links[link].signed)):
                        reason[k] = (
                            f"{variable.key} = {given[k]:g}: not between 0 and 180 deg"
                        )

    def _with_others(self, parts: list[Evaluated], n: int, claim: str) -> Evaluated:
        """Return parts with a row for each of n designs that is in none of them."""
        names = self.figures.names
        others = np.setdiff1d(np.arange(n), np.concatenate([x.design for x in parts]))
        none = Evaluated.of(others, names, status=NEVER_CLOSES, reason=NEVER, claim=claim)
        return Evaluated.in_order([*parts, none], names)

    def _modes(self, kernel: DesignKernel, sizes: Floats) -> Evaluated:
        """Return designs (variables, n) of a kernel in all their modes."""
        parts = []
        prepared = kernel.prepare(sizes)
        shape = len(kernel.places), len(self.figures.rows), sizes.shape[1]
        for signs in product((1.0, -1.0), repeat=len(kernel.places)):
            label = "".join("+" if sign > 0 else "-" for sign in signs)
            turns = self.turns(kernel, prepared, signs)
            places = np.broadcast_to(np.reshape(signs, (-1, 1, 1)), shape)
            parts.append(self.figures.of(kernel, prepared, places, turns, label, COMPLETE))
        return self._with_others(parts, sizes.shape[1], COMPLETE)

    def _followed(
        self, kernel: DesignKernel, sizes: Floats, of_file: Floats
    ) -> tuple[Evaluated, Indices]:
        """Return designs (variables, n) in all their modes, and those that got lost.

        `of_file` (variables, n) are their values in the file's units.
        """
        assert self._paths is not None
        claim = COMPLETE if self._paths[1].counted else SAMPLED
        number, values, labels, lost = self.configurations(sizes)
        prepared = kernel.prepare(sizes[:, number])
        turns = np.zeros((len(kernel.turning), *values.shape[1:]))
        for design in np.unique(number) if kernel.turning else ():
            here = np.flatnonzero(number == design)
            mechanism = self.kernel_mechanism(of_file[:, design])
            turns[:, :, here] = self.turns_at(
                kernel, self.solver_of(mechanism), values[:, :, here]
            )
        made = self.figures.of(kernel, prepared, values, turns, labels, claim)
        every = self._with_others([_numbered(made, number)], sizes.shape[1], claim)
        return every.rows(~np.isin(every.design, lost)), lost

    def configurations(self, sizes: Floats) -> tuple[Indices, Floats, Names, Indices]:
        """Return all modes of designs with the kernel's sizes (k, n), by following.

        At the samples, then at the points of figures; see `followed_modes`.
        """
        assert self._paths is not None
        lattice, place = self._followed_inputs
        design, values, labels, lost = followed_modes(*self._paths, sizes, lattice)
        return design, values[:, place], labels, lost

    def traced(self, mechanism: Mechanism) -> tuple[PositionAnalysis, Motion, Floats]:
        """Return what traced one design, and its motion.

        With the variables (v, samples and points, modes), NaN where a mode does not close.
        """
        lattice = self.samples.lattice
        points = self.figures.points
        given: dict[str, Any] = {"path": lattice.q}
        if not lattice.is_path:
            given = {"samples": lattice.shape}
        given["crossings"] = self.samples.crossings
        tracer = PositionAnalysis(mechanism, self.inputs, **given)
        motions = [tracer.motion()]
        if len(points) and len(self.inputs) == 1:
            motions.append(tracer.at(points[:, :1]))
        elif len(points):
            _, place = self._followed_inputs
            motions.append(tracer.samples(place[len(self.samples.rows) :]))
        parts = [x.values.reshape(-1, x.samples, x.values.shape[1]) for x in motions]
        return tracer, motions[0], np.transpose(np.concatenate(parts, axis=1), (2, 1, 0))

    @cached_property
    def _anchor(self) -> Floats:
        """(inputs,) rad, from where turns count."""
        mechanism = self.mechanism.with_inputs(*self.inputs)
        return PositionSolver(mechanism, plan_assembly(mechanism)).anchor

    def turns(
        self, kernel: DesignKernel, prepared: Floats, signs: Sequence[float]
    ) -> Floats:
        """Return the turns (pairs, samples and points, n) of a kernel's pairs in a mode.

        In rad, of designs prepared (k, n), all groups being dyads.
        """
        rows = self.figures.rows
        count = len(self.inputs)
        n = prepared.shape[1]
        if not kernel.turning:
            return np.zeros((0, len(rows), n))
        first = rows.shape[1] + len(signs)
        function = kernel.angles
        last = first + len(kernel.turning)

        def angles(who: Indices, q: Floats) -> Floats:
            parts = []
            for k in range(0, len(who), TOGETHER):
                some = who[k : k + TOGETHER]
                given = np.zeros((last + len(prepared), len(some)))
                given[:count] = q[k : k + TOGETHER].T
                given[rows.shape[1] : first] = np.reshape(signs, (-1, 1))
                given[last:] = prepared[:, some]
                outputs = function(given)
                closed = np.all(outputs[: kernel.reaches] >= 0.0, axis=0)
                parts.append(np.where(closed, outputs[kernel.reaches :], np.nan))
            return np.concatenate(parts, axis=1)

        q = rows[:, :count]
        contacts = self.varied.contacts
        returns = contacts is None or contacts.train is None
        with np.errstate(all="ignore"):
            if count == 1:
                return turns_along_one(angles, n, self._anchor[0], q[:, 0], returns)
            parts = np.split(q, [len(self.samples.rows)])
            return turns_along_several(angles, n, self._anchor, *parts)

    def kernel_mechanism(self, design: Floats) -> Mechanism:
        """Return the mechanism of a design (variables,) as the kernel has it."""
        mechanism = designed(self.document, self.variables, design)
        if self.varied.contacts is None:
            return mechanism
        contacts = find_equivalent_linkage(mechanism, self.inputs)
        assert contacts is not None
        return contacts.mechanism

    def solver_of(self, mechanism: Mechanism) -> PositionSolver:
        """Return the solver of a mechanism with the inputs of the designs."""
        mechanism = mechanism.with_inputs(*self.inputs)
        return PositionSolver(mechanism, plan_assembly(mechanism))

    def turns_at(
        self, kernel: DesignKernel | RedundantKernel, solver: PositionSolver, values: Floats
    ) -> Floats:
        """Return the turns (pairs, k, modes), rad, of a kernel's pairs.

        Of the mechanism of a solver, where its modes have these values (variables, k,
        modes) in the order of samples.
        """
        made = np.zeros((len(kernel.turning), *values.shape[1:]))
        if not kernel.turning:
            return made
        pairs = [solver.mechanism.angles[name] for name in kernel.turning]
        unwrapping = AngleUnwrapping(solver)
        for mode, of_mode in enumerate(np.moveaxis(values, 2, 0)):
            rows = np.flatnonzero(all_finite(of_mode, 0))
            at = of_mode[:, rows].T
            turned = unwrapping.count(mode, at, at[:, solver.driven], pairs)
            made[:, rows, mode] = TURN * turned[:, pairs].T
        return made

    @cached_property
    def _followed_inputs(self) -> tuple[InputGrid, Indices]:
        """The inputs to follow modes over, and where samples and points are there.

        One input is followed as it grows; several from sample to neighbouring sample, so
        that points are samples.
        """
        lattice = self.samples.lattice
        k = len(self.inputs)
        if k == 1:
            q, place = np.unique(self.figures.rows[:, 0], return_inverse=True)
            return InputGrid(q[:, None], (len(q),)), place
        points = self.figures.points[:, :k]
        away = max_abs(points - lattice.q[:, None], axis=2)
        for point in points[np.min(away, axis=0) > SAME_INPUT]:
            inputs = listing(f"{angle:.6g}" for angle in point)
            raise DesignError(
                f"{self.mechanism.name}: at inputs {inputs} rad: with several inputs "
                "and groups beyond dyads figures are those at samples; choose one"
            )
        return lattice, np.append(np.arange(len(lattice)), np.argmin(away, axis=0))

    # One design after the other.

    def _singly(self, values: Floats) -> Evaluated:
        parts = []
        for k, design in enumerate(values.T):
            try:
                of_design = self._single(designed(self.document, self.variables, design))
            except SpherekitError as problem:
                of_design = refused(problem, self.figures.names)
            parts.append(replace(of_design, design=of_design.design + k))
        return Evaluated.in_order(parts, self.figures.names)

    def _single(self, mechanism: Mechanism) -> Evaluated:
        if not self._is_over_constrained and self.samples.crossings == "end":
            assembly = plan_assembly(mechanism.with_inputs(*self.inputs))
            if assembly.has_closed_form:
                terms = DesignExpressions(mechanism, self.inputs)
                of_signs = DesignKernel(terms, self.figures.columns, compiled=False)
                return self._modes(of_signs, np.empty((0, 1)))
        tracer, motion, values = self.traced(mechanism)
        profiled = self.varied.is_profiled
        modes = tracer.assembly_modes

        def terms_at(configuration: Floats | None) -> DesignExpressions:
            return DesignExpressions(
                mechanism,
                self.inputs,
                make_pairs=lambda _: pair_rotations(mechanism, as_columns=profiled),
                closed_form=False,
                closed=configuration,
                by_rank=tracer.by_rank,
            )

        kernel: DesignKernel | RedundantKernel
        if tracer.by_rank:
            # Equations that are independent in one mode may not be so in another one.
            terms_of_modes = [terms_at(x) for x in most_regular_configurations(motion)]
            if not terms_of_modes:
                names = self.figures.names
                return Evaluated.of([0], names, status=NEVER_CLOSES, reason=NEVER)
            kernel = RedundantKernel(terms_of_modes, self.figures.columns)
        else:
            configuration = next(iter(motion.values[~motion.failed]), None)
            of_variables = terms_at(configuration)
            kernel = DesignKernel(of_variables, self.figures.columns, compiled=False)
        claim = tracer.claim.guarantee.value
        made = self.figures.of(
            kernel,
            kernel.prepare(np.empty((0, len(modes)))),
            values,
            self.turns_at(kernel, tracer.solver, values),
            [f"{mode.number} {mode.label}" for mode in modes],
            claim,
            tracks_of(mechanism) if profiled else (),
        )
        return self._with_others([replace(made, design=0 * made.design)], 1, claim)


def most_regular_configurations(motion: Motion) -> list[Floats]:
    """Return of each assembly mode the configuration farthest from a singular one.

    Parameters
    ----------
    motion
        Samples of one mechanism in its modes.

    Returns
    -------
    (variables,) rad of each mode that closes at a sample: where the least singular value of
    the closure equations, the inputs locked, is largest.
    """
    closed = np.flatnonzero(~motion.failed)
    if not len(closed):
        return []
    jacobians = motion.linearisation.jacobian[closed][:, :, list(motion.passive_variables)]
    least = np.linalg.svd(jacobians, compute_uv=False)[:, -1]
    modes = motion.assembly_mode[closed]
    best = [np.flatnonzero(modes == mode) for mode in np.unique(modes)]
    return [motion.values[closed[rows[np.argmax(least[rows])]]] for rows in best]


def _numbered(made: Evaluated, numbers: Indices) -> Evaluated:
    """Return rows whose designs have these numbers among others."""
    return replace(made, design=numbers[made.design])
