"""The page of a mechanism: what it says, the kernels that move it, and its parts."""

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from fnmatch import fnmatchcase
from functools import cached_property
from importlib.resources import files
from itertools import combinations, permutations
from string import Template

import numpy as np

from spherekit.conventions import Facts, Names
from spherekit.designs.design_variables import (
    DesignVariable,
    default_size_keys,
    design_variable,
)
from spherekit.display.pages.sliders import slider_range
from spherekit.display.pages.toml_template import text_with_places
from spherekit.errors import EngineError, SpherekitError
from spherekit.escaping import html_text, json_text
from spherekit.exchange.formula_expressions import Formulas
from spherekit.exchange.formula_maker import CLOSURE_PREFIX, formulas
from spherekit.exchange.size_arguments import check_arguments, idle_arguments
from spherekit.exchange.source_languages import source
from spherekit.files.mechanism_reader import AnyMechanism, mechanism_of
from spherekit.files.number_change import document_of
from spherekit.files.study import Crossings
from spherekit.mechanism.elements import Input
from spherekit.mechanism.friction import check_no_reaction_friction
from spherekit.mechanism.joint_construction import make_joints
from spherekit.mechanism.load_dependence import wound_pairs
from spherekit.mechanism.pair_frames import link_axes
from spherekit.planning.assembly_plan import driven_at, driven_pairs
from spherekit.planning.plan_text import describe, pole_name
from spherekit.planning.pole_plan import (
    BlockPoles,
    LinePole,
    Plan,
    Pole,
    Step,
    pole_of,
    table_cells,
)
from spherekit.planning.pole_planner import plans
from spherekit.positions.mode_meetings import degrees_text
from spherekit.positions.motion_cache import (
    assembly_by_count_or_rank,
    is_mobile_by_rank_only,
)
from spherekit.positions.position_solver import PositionSolver
from spherekit.scenes.link_scenes import PROFILE_POINTS
from spherekit.velocities.load_numbers import LOAD_DEPENDENT_PREFIXES
from spherekit.velocities.row_quantities import middle_pairs, row_quantities
from spherekit.version import __version__
from spherekit.wording import listing

SCRIPTS = (
    "script/1_state.js",
    "script/2_smooth_modes.js",
    "script/2_motion.js",
    "script/2_feasible_ranges.js",
    "script/3_sphere.js",
    "script/4_mode_styles.js",
    "script/4_mechanism.js",
    "script/5_poles.js",
    "script/6_turns.js",
    "script/6_signs.js",
    "script/6_joint_limits.js",
    "script/6_curves.js",
    "script/7_reach.js",
    "script/8_controls.js",
    "script/9_pictures.js",
)
AXES = "xyz"
LIMIT_KEY = ' <i class="limit"></i> beyond a joint limit'
MOTION = ("q", "dq", "ddq")
"""What a page gives its kernels, besides whole turns of passive pairs: no time."""


class PageMaker:
    """What a page holds of a mechanism; arguments as of `spherekit.page`."""

    def __init__(
        self,
        given: AnyMechanism,
        vary: Sequence[str] | None,
        quantities: Sequence[str] | None,
        input_pair: str | Sequence[str] | None,
        crossings: Crossings = "end",
    ) -> None:
        self.given, self.input_pair = given, input_pair
        self.crossings = crossings
        self.mechanism = driven_at(mechanism_of(given), input_pair)
        self.document = document_of(given)
        self.inputs = self.mechanism.names_of(driven_pairs(self.mechanism))
        self.every = row_quantities(self.mechanism)
        self.quantities, self.notes = quantities, list[str]()
        self.has_named_sizes = vary is not None
        self.keys = self._sizes() if vary is None else tuple(vary)
        self.plans = self._plans()

    def page(self) -> tuple[str, int, int]:
        """Return the page, and how many curves and assembly modes it has."""
        rows = self._rows()
        asked = self._default(masses=True) if self.quantities is None else self.quantities
        shown = [x for x in rows.results if any(fnmatchcase(x, name) for name in asked)]
        kernels = {"rows": rows, "picture": self._formulas(self._drawn())}
        if self.has_named_sizes:
            check_arguments(kernels.values())
        elif idle := idle_arguments(kernels.values()):
            self.notes += (f"no slider for {key}: nothing changes with it" for key in idle)
            self.keys = tuple(key for key in self.keys if key not in idle)
            return self.page()
        self.notes += (f"left out: assembly mode {x}" for x in rows.mode_table.left_out)
        if self.crossings == "pass" and rows.step:
            self.notes.append(
                "no curves are known to cross with the sizes of the file; where they do "
                "with others, modes end, as positions have no closed form"
            )
        model = self.model(shown, rows.results, has_closed_form=not rows.step)
        text = self._assembled(model, _kernels(kernels))
        return text, len(shown), len(rows.modes)

    # Quantities, and what is drawn.

    @property
    def _ends(self) -> list[str]:
        """How quantities end that are of one input while the others rest."""
        inputs = self.inputs
        return [""] if len(inputs) == 1 else [f"_by_{pair}" for pair in inputs]

    def _formulas(self, names: Sequence[str]) -> Formulas:
        made = formulas(
            self.given, names, self.keys, self.input_pair, crossings=self.crossings
        )
        self._check_smooth_curves(made)
        # The page finds the crossings for its own sizes, so it needs no table of them.
        made = replace(made, mode_table=made.mode_table._replace(smooth=None))
        turn_arguments = {f"turns_of_{pair}" for pair in self._wound_pairs}
        others = [
            x.name
            for x in made.motion
            if x.name.split("_")[0] not in MOTION and x.name not in turn_arguments
        ]
        if others:
            raise EngineError(
                f"a page does not know of {listing(others)}, which loads follow"
            )
        return made

    def _check_smooth_curves(self, made: Formulas) -> None:
        """Refuse crossings of modes that a page follows by Newton's steps.

        Raises
        ------
        EngineError
            If positions have no closed form, and curves of modes cross.
        """
        smooth = made.mode_table.smooth
        if made.step and smooth is not None and smooth.crossings:
            inputs = listing(dict.fromkeys(map(degrees_text, smooth.crossings)))
            raise EngineError(
                f"{self.mechanism.name}: curves cross at {inputs} deg, and positions have "
                "no closed form: a page follows modes by Newton's steps, which end there; "
                'leave crossings at "end", or export a source, which has a start on each '
                "side of a crossing"
            )

    @property
    def _wound_pairs(self) -> list[str]:
        """Return the passive pairs whose whole turns a page counts: those of one input.

        It counts none if modes pass through crossings, as turns are counted along modes
        with constant signs.
        """
        if len(self.inputs) > 1 or self.crossings == "pass":
            return []
        return [x for x in wound_pairs(self.mechanism) if x not in self.inputs]

    def _wound(self, pair: str) -> Facts:
        """Return from which input (rad) the turns of a passive pair count.

        After a `period` (rad) of the input all configurations return; None without one.
        """
        solver = PositionSolver(self.mechanism, assembly_by_count_or_rank(self.mechanism))
        (anchor,), (period,) = solver.anchor, solver.periods
        return {
            "pair": pair,
            "anchor": float(anchor),
            "period": float(period) if np.isfinite(period) else None,
        }

    def _passed_crossings(self) -> Facts:
        """Return what the page is told of modes that pass through crossings.

        `anchor` is the input (rad) of the reference pose, at which smooth curves have the
        numbers of the modes. It is None if it is not in the range.
        """
        solver = PositionSolver(self.mechanism, assembly_by_count_or_rank(self.mechanism))
        (anchor,), (driven,) = solver.anchor, self.mechanism.inputs
        low, high = driven.range
        if solver.reference is None or not low <= anchor <= high:
            return {"anchor": None}
        return {"anchor": float(anchor)}

    def _sizes(self) -> Names:
        """Return the keys of all arcs and angles, of those that can be varied."""
        first = next(iter(self.every))
        keys = self._axes_by_angles(default_size_keys(self.mechanism))
        if not self.mechanism.has_contacts:
            return keys
        kept = []
        for key in keys:
            try:
                formulas(self.given, [first], [key], self.input_pair)
                kept.append(key)
            except SpherekitError as problem:
                self.notes.append(f"no slider for {key}: {problem}")
        return tuple(kept)

    def _axes_by_angles(self, keys: Names) -> Names:
        """Return those of the keys of axes whose numbers stand in the file.

        The file of a P pair may state two directions of its arc instead of its axis.
        """
        without_axis = [
            name
            for name, table in self.document.data["pairs"].items()
            if "through_xyz" in table or "through_lonlat" in table
        ]
        self.notes += (
            f"no slider for the axis of {name}, which the file states by two directions of "
            "its arc; state it by lonlat to vary it"
            for name in without_axis
        )
        return tuple(
            key
            for key in keys
            if key.split(".")[:2] not in [["pairs", name] for name in without_axis]
        )

    def _coefficients(self, end: str) -> list[str]:
        """Return the velocity coefficients of outputs, without any of the last link."""
        mechanism = self.mechanism
        ends = [(x.link, x.relative_to) for x in mechanism.outputs]
        return [
            f"velocity_coefficient_{link}_{other}{end}"
            for link, other in ends or [(mechanism.links[-1], mechanism.ground)]
        ]

    def _default(self, masses: bool) -> list[str]:
        """Return the quantities that are shown by default."""
        names = [name for end in self._ends for name in self._coefficients(end)]
        names += [f"transmission_angle_{pair}" for pair in middle_pairs(self.mechanism)]
        if masses and self.mechanism.masses:
            names += [f"torque{end}" for end in self._ends]
        return names

    @property
    def _paths(self) -> list[tuple[str, str]]:
        """What paths are drawn of, and the link that carries it."""
        mechanism = self.mechanism
        stems = []
        for output in mechanism.outputs:
            if output.direction is not None and output.relative_to == mechanism.ground:
                stems.append((f"direction_{output.name}", output.link))
                continue
            for pair in mechanism.pairs:
                moves = output.link in pair.links and mechanism.ground not in pair.links
                if pair.kind.has_axis and moves:
                    stems.append((f"axis_{pair.name}", output.link))
        return stems

    @property
    def _stops(self) -> str:
        """The determinant that is zero where the first output stops, if there is one."""
        names = (f"jacobian_determinant_{output.name}" for output in self.mechanism.outputs)
        return next((name for name in names if name in self.every), "")

    def _signed_poles(self, names: Iterable[str]) -> dict[tuple[str, str, str], list[str]]:
        """Return the quantities whose signs a page gives, by two links and the input's end.

        A pole axis of links that no pair joins has two senses. A page signs velocity and
        acceleration coefficients and pole axes of such links as `sk.evaluate` does.
        """
        mechanism = self.mechanism
        joined = [frozenset(x.links) for x in mechanism.pairs if x.kind.has_axis]
        signed: dict[tuple[str, str, str], list[str]] = {}
        for a, b in permutations(mechanism.links, 2):
            if frozenset((a, b)) in joined:
                continue
            for end in self._ends:
                names_of_pole = [
                    f"velocity_coefficient_{a}_{b}{end}",
                    f"acceleration_coefficient_{a}_{b}{end}",
                    *(f"pole_{a}_{b}_{x}{end}" for x in AXES),
                ]
                signed[a, b, end] = [x for x in names_of_pole if x in names]
        return {key: of_pole for key, of_pole in signed.items() if of_pole}

    def _velocities_of_signs(self, names: Iterable[str]) -> list[str]:
        """Return the components of angular velocities from which a page finds signs."""
        return [
            f"angular_velocity_{link}_{x}{end}"
            for *links, end in self._signed_poles(names)
            for link in links
            if link != self.mechanism.ground
            for x in AXES
        ]

    def _rows(self) -> Formulas:
        """Return the formulas of what is computed at every sample of every mode."""
        needed = [name for end in self._ends for name in self._coefficients(end)]
        needed += [f"{stem}_{x}" for stem, _ in self._paths for x in AXES]
        needed += [name for name in ("determinant", self._stops) if name in self.every]
        needed += [
            f"theta_{limit.pair}"
            for limit in self.mechanism.joint_limits
            if limit.pair not in self.inputs
        ]
        needed += [f"theta_{pair}" for pair in self._wound_pairs]
        made = self._formulas_with_masses(needed)
        more = [x for x in self._velocities_of_signs(made.results) if x not in made.results]
        if not made.step:
            more += [f"{CLOSURE_PREFIX}{k + 1}" for k in range(len(made.places))]
        return self._formulas([*made.results, *more]) if more else made

    def _formulas_with_masses(self, needed: Sequence[str]) -> Formulas:
        """Return the formulas of what is asked for; by default of torques too."""
        if self.quantities is not None:
            return self._formulas([*self.quantities, *needed])
        try:
            check_no_reaction_friction(self.mechanism, "a page does not solve for")
            return self._formulas([*self._default(masses=True), *needed])
        except SpherekitError as problem:
            if not self.mechanism.masses:
                raise
            self.notes.append(f"no driving torque: {problem}")
            return self._formulas([*self._default(masses=False), *needed])

    def _drawn(self) -> list[str]:
        """Return what is computed at the cursor: axes, orientations, poles."""
        mechanism = self.mechanism
        links = mechanism.links
        names = [
            f"axis_{pair.name}_{x}"
            for pair in mechanism.pairs
            if pair.kind.has_axis
            for x in AXES
        ]
        names += [
            f"orientation_{link}_{x}{y}"
            for link in links
            if link != mechanism.ground
            for x in AXES
            for y in AXES
        ]
        names += [
            f"pole_{links[j]}_{links[i]}_{x}{end}"
            for end, planned in zip(self._ends, self.plans, strict=True)
            for i, j in combinations(planned.bodies, 2)
            for x in AXES
        ]
        return names

    def _plans(self) -> tuple[Plan, ...]:
        return plans(self.mechanism, is_mobile_by_rank_only(self.mechanism))

    # What the page is told.

    def _assembled(self, model: Facts, kernels: str) -> str:
        """Return the page, of its parts."""
        mechanism = self.mechanism
        source = mechanism.source
        return Template(_part("page.html")).substitute(
            title=html_text(mechanism.name),
            citation=html_text(source.citation if source else ""),
            version=__version__,
            css=_part("parts/uplot.css") + _part("page.css"),
            limit_key=LIMIT_KEY if mechanism.joint_limits else "",
            uplot=_part("parts/uplot.js"),
            model=json_text(model),
            kernels=kernels,
            scripts="\n".join(map(_part, SCRIPTS)),
        )

    @cached_property
    def _numbers(self) -> list[DesignVariable]:
        return [design_variable(self.document, key) for key in self.keys]

    def model(
        self,
        shown: Sequence[str],
        computed: Iterable[str] = (),
        has_closed_form: bool = True,
    ) -> Facts:
        """Return what the page's scripts read.

        Parameters
        ----------
        shown
            The quantities that have curves.
        computed
            The quantities that the page computes at every sample.
        has_closed_form
            Whether positions follow from signs of dyads. If not, modes are followed by
            Newton's steps, which pass no crossings.
        """
        passes_crossings = self.crossings == "pass" and has_closed_form
        signed = self._signed_poles([*computed])
        mechanism = self.mechanism
        return {
            "name": mechanism.name,
            "angle_unit": self.document.data["angle_unit"],
            "inputs": [*map(self._input, mechanism.inputs)],
            "links": [*map(self._link, mechanism.links)],
            "pairs": [
                {
                    "name": x.name,
                    "links": x.links,
                    "axis": x.kind.has_axis,
                    "variables": len(mechanism.variables_of(number)),
                }
                for number, x in enumerate(mechanism.pairs)
            ],
            "outputs": [
                {"name": x.name, "link": x.link, "direction": x.direction}
                for x in mechanism.outputs
            ],
            "sizes": [*map(self._slider, self._numbers)],
            "quantities": [self._quantity(name) for name in shown],
            "coefficients": [*map(self._coefficients, self._ends)],
            "paths": [{"stem": stem, "link": link} for stem, link in self._paths],
            "stops": self._stops,
            "signed": [
                {"links": [a, b], "end": end, "names": names}
                for (a, b, end), names in signed.items()
            ],
            "limits": [
                {"pair": x.pair, "low": x.low, "high": x.high}
                for x in mechanism.joint_limits
            ],
            "wound": [*map(self._wound, self._wound_pairs)],
            "crossings": self._passed_crossings() if passes_crossings else None,
            "moving": any(
                name.startswith((*LOAD_DEPENDENT_PREFIXES, "kinetic_energy"))
                for name in shown
            ),
            "plans": [*map(self._plan, self._ends, self.plans)],
            "toml": text_with_places(self.document, [x.path for x in self._numbers]),
        }

    def _input(self, driven: Input) -> Facts:
        pair = self.mechanism.pairs[self.mechanism.pair_number[driven.pair]]
        axes = link_axes(self.mechanism)
        return {
            "pair": pair.name,
            "links": pair.links,
            "from": driven.range[0],
            "to": driven.range[1],
            "axes": {link: axes[link][pair.name].tolist() for link in pair.links},
        }

    def _link(self, link: str) -> Facts:
        """Return the pairs of a link, and its profiles as points in its axes."""
        mechanism, profiles = self.mechanism, []
        for pair, joint in zip(mechanism.pairs, make_joints(mechanism), strict=True):
            if pair.profiles is None or link not in pair.links:
                continue
            which = pair.links.index(link)
            profile, curve = pair.profiles[which], joint.contact_profiles[which].curve
            points = curve.evaluate(np.linspace(0.0, curve.length, PROFILE_POINTS)).frame
            profiles.append(
                {
                    "pair": pair.name,
                    "curve": np.round(points[:, :, 2], 6).tolist(),
                    "centre": profile.centre,
                    "radius": profile.radius,
                    "rolls": pair.rolls and profile.radius is not None,
                }
            )
        return {"name": link, "pairs": [*link_axes(mechanism)[link]], "profiles": profiles}

    def _slider(self, number: DesignVariable) -> Facts:
        slider = slider_range(self.document, self.mechanism, number)
        unit = "rad" if number.is_angle else ""
        return {"key": number.key, "value": number.value, "unit": unit, **slider.facts()}

    def _quantity(self, name: str) -> Facts:
        label = name.replace("dB_dq", "dB/dq").replace("_", " ")
        for a, b in permutations(self.mechanism.links, 2):
            of_two = re.fullmatch(
                rf"(\w+_coefficient|pole)_{re.escape(a)}_{re.escape(b)}(|_.*)", name
            )
            if of_two:
                kind, end = of_two.groups()
                label = f"{kind} {a}/{b}{end}".replace("_", " ")
        unit = self.every[name]
        return {"name": name, "unit": unit, "label": label, "size": self._size(unit)}

    def _size(self, unit: str) -> float:
        """Return the natural size of quantities of a unit, 0.0 where there is none.

        Changes that are far smaller are rounding, and a page draws them level.
        """
        if unit in ("", "rad", "1/rad"):
            return 1.0
        if unit in ("N m", "kg m2", "kg m2/rad", "J"):
            # At rates of 1 rad/s.
            tensors = [np.abs(mass.tensor) for mass in self.mechanism.masses]
            return float(np.max(tensors, initial=0.0))
        return 0.0

    def _plan(self, end: str, planned: Plan) -> Facts:
        """Return the Table and its steps, with poles as pairs of names of links."""
        links, pairs = planned.mechanism.links, planned.mechanism.pairs

        def named(pole: Pole) -> list[str]:
            return [links[number] for number in pole[::-1]]

        def steps(step: Step) -> Iterator[Facts]:
            said = describe(planned, step).split("\n")[0]
            one: Facts = {"text": said, "lines": [], "contacts": []}
            if isinstance(step, BlockPoles):
                later = {inner.pole for inner in step.passes}
                yield one | {"poles": [named(x) for x in step.poles if x not in later]}
                for inner in step.passes:
                    yield from steps(inner)
                return
            if isinstance(step, LinePole):
                one["lines"] = [[named(pole_of(k, x)) for x in step.pole] for k in step.via]
                one["contacts"] = planned.mechanism.names_of(step.contacts)
            yield one | {"poles": [named(step.pole)]}

        return {
            "moves": pairs[planned.input].name,
            "end": end,
            "titles": [*map(planned.name, planned.bodies)],
            "bodies": [links[body] for body in planned.bodies],
            "cells": table_cells(planned),
            "labels": {
                ",".join(named(pole)): pole_name(planned, pole)
                for pole in combinations(planned.bodies, 2)
            },
            "steps": [facts for step in planned.steps for facts in steps(step)],
        }


def _part(name: str) -> str:
    return files(__package__).joinpath(name).read_text("utf-8")


def _kernels(made: Mapping[str, Formulas]) -> str:
    """Return the exported functions, by the names under which the page has them."""
    parts = []
    for key, of in made.items():
        text = re.sub(r"^export ", "", source(of, "js"), flags=re.M)
        (name,) = re.findall(r"^const (\w+)_about\b", text, re.M)
        step = f"{name}_step" if of.step else "null"
        parts.append(
            f"{key}: (() => {{\n{text}\n"
            f"return {{about: {name}_about, at: {name}, step: {step}}};\n}})(),"
        )
    return "\n".join(["const KERNELS = {", *parts, "};"])
