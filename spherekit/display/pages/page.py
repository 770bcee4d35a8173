"""Makes the interactive page of a mechanism: its data, its kernels, and its text."""

import re
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import replace
from fnmatch import fnmatchcase
from functools import cached_property
from importlib.resources import files
from string import Template
from typing import NamedTuple

import numpy as np

from spherekit.conventions import Facts, Names
from spherekit.designs.design_variables import (
    DesignVariable,
    default_size_keys,
    design_variable,
)
from spherekit.display.pages.page_facts import (
    input_facts,
    link_facts,
    pair_facts,
    plan_facts,
    quantity_facts,
)
from spherekit.display.pages.page_quantities import PageQuantities
from spherekit.display.pages.sliders import slider_range
from spherekit.display.pages.toml_template import split_at_numbers
from spherekit.errors import EngineError, SpherekitError
from spherekit.escaping import html_text, json_text
from spherekit.exchange.formula_expressions import Formulas
from spherekit.exchange.formula_maker import CLOSURE_PREFIX, formulas
from spherekit.exchange.size_arguments import check_arguments, idle_arguments
from spherekit.exchange.source_languages import source
from spherekit.files.mechanism_reader import AnyMechanism, mechanism_of
from spherekit.files.number_change import document_of
from spherekit.files.study import Crossings
from spherekit.mechanism.friction import check_no_reaction_friction
from spherekit.mechanism.load_dependence import wound_pairs
from spherekit.planning.assembly_plan import driven_at, driven_pairs
from spherekit.planning.pole_planner import plans
from spherekit.positions.mode_meetings import degrees_text
from spherekit.positions.motion_cache import (
    assembly_by_count_or_rank,
    is_mobile_by_rank_only,
)
from spherekit.positions.position_solver import PositionSolver
from spherekit.velocities.load_numbers import LOAD_DEPENDENT_PREFIXES
from spherekit.version import __version__
from spherekit.wording import listing, numbered

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
"""Scripts of the page, in the order in which they run."""

JOINT_LIMIT_KEY = ' <span><i class="limit"></i>beyond a joint limit</span>'
"""Line of the legend on pages of mechanisms with joint limits."""

MOTION_ARGUMENTS = ("q", "dq", "ddq")
"""Beginnings of the names of motion arguments that a page has: ``q_21``, for example.

The motion arguments of kernels (functions in JavaScript) describe a sample. A page has no
time. A page with one input also counts whole turns of passive pairs.
"""


class PageText(NamedTuple):
    """The text of a page, with the numbers of its curves and of its assembly modes."""

    text: str
    curve_count: int
    mode_count: int


class PageMaker:
    """Makes the interactive HTML page of one mechanism.

    Attributes
    ----------
    keys
        Keys, such as ``"links.2.arc"``, of the numbers of the file that have sliders.
    notes
        What the page leaves out, in sentences.
    """

    def __init__(
        self,
        mechanism: AnyMechanism,
        vary: Sequence[str] | None,
        quantities: Sequence[str] | None,
        input_pair: str | Sequence[str] | None,
        crossings: Crossings = "end",
    ) -> None:
        """Read the mechanism of a page and choose the numbers that get sliders.

        Parameters
        ----------
        mechanism
            The mechanism, the name of a shipped one, or the path of a file.
        vary
            Keys of the numbers of the mechanism file that get sliders. None: all sizes.
        quantities
            Names or patterns of the quantities that get curves. None: the default
            quantities.
        input_pair
            The driven pairs (joints). None: the inputs of the mechanism.
        crossings
            How an assembly mode (way to assemble the mechanism) continues where two smooth
            curves of configurations over the input cross. With "pass", the mode follows its
            smooth curve through the crossing. With "end", it keeps the signs of its dyads.
            It then passes from one smooth curve to the other, in general with a kink. A
            dyad is two links with three R pairs, and its sign selects one of the two ways
            to assemble them.
        """
        # The mechanism as the caller states it: an object, a name or a path. `formulas`
        # accepts all of them.
        self._stated_mechanism = mechanism
        self._input_pair = input_pair
        self._crossings = crossings
        self._mechanism = driven_at(mechanism_of(mechanism), input_pair)
        # The content of the mechanism file. A slider changes one number of it.
        self._document = document_of(mechanism)
        self._inputs = self._mechanism.names_of(driven_pairs(self._mechanism))
        self._page_quantities = PageQuantities(self._mechanism, self._inputs)
        self._requested_quantities = quantities
        self.notes: list[str] = []
        # Keys of the numbers with sliders: those that the user names, or all sizes.
        self._has_named_sizes = vary is not None
        self.keys = self._find_sizes() if vary is None else tuple(vary)
        # There is one plan for each input, which moves while the other inputs are locked. A
        # plan lists the steps that construct all pole axes (axes of relative rotation of
        # two links). Counting links and pairs gives too small a mobility if constraints are
        # redundant. `moves_by_rank` then tells `plans` that the mechanism moves all the
        # same, as the rank of the velocity equations shows.
        moves_by_rank = is_mobile_by_rank_only(self._mechanism)
        self._pole_plans = plans(self._mechanism, moves_by_rank)

    def make_page(self) -> PageText:
        """Return the text of the interactive page, with its numbers of curves and modes.

        A kernel is a set of JavaScript functions. One kernel computes all quantities at
        every sample. Another kernel computes the picture at the cursor.

        Sliders change numbers of the mechanism file. By default all sizes that can vary
        have a slider, except those that change no result.

        Raises
        ------
        DesignError
            If the user requested a slider for a number that changes no result.
        """
        row_formulas = self._make_row_formulas()
        # `step`, a step of Newton's method, is empty if positions have a closed form.
        has_closed_form = not row_formulas.step
        # Names of quantities, which may contain wildcards such as "*".
        shown_patterns = self._requested_quantities
        if shown_patterns is None:
            shown_patterns = self._page_quantities.default_names(with_torques=True)
        # Results that only the scripts of the page use are no quantities of the mechanism.
        unit_by_name = self._page_quantities.unit_by_name
        shown_names = [
            name
            for name in row_formulas.results
            if name in unit_by_name and _matches_any(name, shown_patterns)
        ]
        # The quantities that are needed to draw links, pairs (joints) and poles (axes of
        # the relative rotation of two links).
        drawn_names = self._page_quantities.drawn_names(self._pole_plans)
        formulas_by_kernel = {
            "rows": row_formulas,
            "picture": self._make_formulas(drawn_names),
        }
        if self._has_named_sizes:
            # The user requested the sliders. Raise an error if one of their numbers changes
            # no result.
            check_arguments(formulas_by_kernel.values())
        elif idle_keys := idle_arguments(formulas_by_kernel.values()):
            # `idle_keys` name numbers in the file that change no result. Make the page
            # without their sliders.
            self._leave_out_sliders(idle_keys)
            return self.make_page()
        for reason, names in row_formulas.mode_table.left_out_by_reason().items():
            self.notes.append(f"left out: assembly {numbered('mode', names)}: {reason}")
        # The configurations of an assembly mode (way to assemble the mechanism) form a
        # curve over the input. Modes can continue through a crossing of two curves ("pass")
        # only if positions have a closed form. Crossings with the sizes of the file would
        # have raised an error above.
        wants_to_pass_crossings = self._crossings == "pass"
        if wants_to_pass_crossings and not has_closed_form:
            self.notes.append(
                "with the sizes of the file, no curves are known to cross; if they "
                "cross with other sizes, modes end there, because positions have no "
                "closed form"
            )
        model = self.make_model(
            shown_names, row_formulas.results, has_closed_form=has_closed_form
        )
        text = self._fill_page(model, _write_kernels(formulas_by_kernel))
        # Each shown quantity has a curve.
        return PageText(text, len(shown_names), len(row_formulas.modes))

    # Formulas of the kernels

    def _leave_out_sliders(self, idle_keys: Collection[str]) -> None:
        """Remove the sliders of some numbers, with a note for each."""
        for key in idle_keys:
            self.notes.append(f"no slider for {key}: nothing changes with it")
        self.keys = tuple(key for key in self.keys if key not in idle_keys)

    def _make_formulas(self, names: Sequence[str]) -> Formulas:
        """Return formulas of quantities, after a check that the page can use them.

        The page evaluates the formulas at samples of the inputs. Numbers of the mechanism
        file with a slider are arguments of the formulas.

        Parameters
        ----------
        names
            Names of the quantities.

        Raises
        ------
        EngineError
            - If quantities depend on arguments that the page does not have, such as the
              time.
            - If modes should pass crossings of their configuration curves, but positions
              have no closed form.
        """
        page_formulas = formulas(
            self._stated_mechanism,  # an object, a name or a path
            names,
            self.keys,  # numbers with sliders are arguments of the formulas
            self._input_pair,
            crossings=self._crossings,
        )
        self._check_smooth_curves(page_formulas)
        self._check_arguments(page_formulas)
        # `mode_table` lists the assembly modes (ways to assemble the mechanism). The field
        # `smooth` has the inputs at which the configuration curves of modes cross, for the
        # sizes in the file. A slider changes these inputs. They are left out here, because
        # the page computes the crossings itself.
        return replace(
            page_formulas, mode_table=page_formulas.mode_table._replace(smooth=None)
        )

    def _check_arguments(self, page_formulas: Formulas) -> None:
        """Raise an error if formulas have arguments that the page does not have.

        The scripts of the page evaluate the formulas in the browser. They know the inputs,
        their rates and their accelerations. They also count whole revolutions of passive
        (not driven) pairs on which loads depend, such as a wound spring.

        Raises
        ------
        EngineError
            If a quantity or load depends on other arguments, such as the time.
        """
        turn_arguments = {f"turns_of_{pair}" for pair in self._wound_pairs}
        # `motion` lists the arguments that describe the motion. The names of inputs begin
        # with "q", of their rates with "dq", and of their accelerations with "ddq".
        unknown_arguments: list[str] = []
        for argument in page_formulas.motion:
            kind = argument.name.split("_")[0]
            if kind not in MOTION_ARGUMENTS and argument.name not in turn_arguments:
                unknown_arguments.append(argument.name)
        if unknown_arguments:
            unknown = listing(unknown_arguments)
            raise EngineError(
                f"quantities depend on {unknown}, which pages do not support; request "
                f"other quantities, or remove the loads that depend on {unknown} from the "
                "file"
            )

    def _check_smooth_curves(self, page_formulas: Formulas) -> None:
        """Raise an error if modes cannot pass the crossings of their configuration curves.

        Configuration curves of two assembly modes (ways to assemble the mechanism) can
        cross. With the option "pass", a mode follows its smooth curve through the crossing.
        On a page this needs a closed form of the positions. Without one, the page follows a
        mode by Newton's method, which cannot pass a crossing.

        Parameters
        ----------
        page_formulas
            Formulas of the page. The table of modes in them has the crossings.

        Raises
        ------
        EngineError
            If positions have no closed form, and curves of modes cross.
        """
        # `step`, a step of Newton's method, is empty in closed form.
        has_closed_form = not page_formulas.step
        # None: modes end at crossings.
        smooth_modes = page_formulas.mode_table.smooth
        if has_closed_form or smooth_modes is None or not smooth_modes.crossings:
            return
        inputs = listing(dict.fromkeys(map(degrees_text, smooth_modes.crossings)))
        raise EngineError(
            f"{self._mechanism.name}: configuration curves cross at {inputs} deg, and "
            "positions have no closed form. A page then follows modes by Newton's method, "
            'which cannot pass a crossing; leave crossings at "end", or export source '
            "code, which has a start on each side of a crossing"
        )

    def _make_row_formulas(self) -> Formulas:
        """Return the formulas that the page evaluates at every sample of every mode.

        An assembly mode is one way to assemble the mechanism. The formulas compute the
        quantities that the page shows or needs. A first set of formulas tells which further
        quantities are needed, for example to choose directions of axes. A second set
        includes these quantities.
        """
        # Pairs at which springs or other loads count whole revolutions. The page needs the
        # angles of these pairs, to count their revolutions.
        wound_pairs = self._wound_pairs
        needed_names = self._page_quantities.needed_names(wound_pairs)
        # The driving torques are among the results, if they can be written as formulas.
        first_formulas = self._make_formulas_with_torques(needed_names)
        added_names = self._find_added_names(first_formulas)
        if not added_names:
            return first_formulas
        all_names = [*first_formulas.results, *added_names]
        return self._make_formulas(all_names)

    def _find_added_names(self, row_formulas: Formulas) -> list[str]:
        """Return the names of further quantities that the page has to evaluate.

        There are two kinds:

        - Angular velocities of links. A pole axis (axis of relative rotation of two links)
          has two opposite directions. The page chooses one direction, which must not jump
          to the opposite direction during the motion. This choice depends on the relative
          angular velocity.
        - A number for each dyad (two links between two known axes), which is negative if
          the links are too short to meet. This number exists only if positions have
          formulas (closed form).

        Parameters
        ----------
        row_formulas
            Formulas of the quantities that the page shows or needs.
        """
        # Names of the components of the angular velocities.
        velocity_names = self._page_quantities.sign_velocities(row_formulas.results)
        added_names = [name for name in velocity_names if name not in row_formulas.results]
        # Positions without a closed form are found by steps of Newton's method.
        has_closed_form = not row_formulas.step
        if has_closed_form:
            # In closed form, an assembly mode (way to assemble the mechanism) is described
            # by one number for each dyad, its sign.
            dyad_count = len(row_formulas.mode_value_names)
            for dyad in range(dyad_count):
                added_names.append(f"{CLOSURE_PREFIX}{dyad + 1}")
        return added_names

    def _make_formulas_with_torques(self, needed_names: Sequence[str]) -> Formulas:
        """Return the formulas of the quantities that the page shows or needs.

        By default driving torques are among them. Some torques cannot be written as
        formulas, for example with friction that depends on reactions in pairs (joints).
        Such torques are left out with a note.

        Parameters
        ----------
        needed_names
            Quantities that the page needs, shown or not.
        """
        if self._requested_quantities is not None:
            return self._make_formulas([*self._requested_quantities, *needed_names])
        try:
            # By default torques are shown if there are masses. The check raises an error if
            # there is friction that depends on reactions. Its message contains "a page".
            if self._mechanism.masses:
                check_no_reaction_friction(self._mechanism, "a page")
            names = self._page_quantities.default_names(with_torques=True)
            return self._make_formulas([*names, *needed_names])
        except SpherekitError as problem:
            if not self._mechanism.masses:
                raise  # there were no torques, so the error has another reason
            self.notes.append(f"driving torque left out: {problem}")
            names = self._page_quantities.default_names(with_torques=False)
            return self._make_formulas([*names, *needed_names])

    # Sizes with sliders

    def _find_sizes(self) -> Names:
        """Return the keys of the arcs and angles of the mechanism file that get a slider.

        A note for users says which sizes get no slider. These are axes that the file states
        by two directions perpendicular to them. With contacts, these are also sizes that
        cannot be arguments of formulas.
        """
        # An axis that the file states by two other directions has no number to vary.
        keys = self._omit_axes_by_directions(default_size_keys(self._mechanism))
        if not self._mechanism.has_contacts:
            return keys
        # With contacts some sizes cannot be arguments of formulas. So formulas of an
        # arbitrary quantity are created for each size, to see whether there is an error.
        any_quantity = next(iter(self._page_quantities.unit_by_name))
        variable_keys: list[str] = []
        for key in keys:
            try:
                formulas(self._stated_mechanism, [any_quantity], [key], self._input_pair)
            except SpherekitError as problem:
                self.notes.append(f"no slider for {key}: {problem}")
            else:
                variable_keys.append(key)
        return tuple(variable_keys)

    def _omit_axes_by_directions(self, keys: Names) -> Names:
        """Return the keys without those of axes that the file states by two directions.

        Each key that is returned gets a slider. In a P pair (joint) one link slides along
        an arc of a great circle on the other link. The axis of the pair is the normal of
        the plane of this circle. The mechanism file can state the axis by two directions on
        the arc. Such an axis has no numbers of its own in the file that a slider could
        vary. Its keys are left out, and a note is added.

        Parameters
        ----------
        keys
            Keys of sizes (see `default_size_keys`). Keys that begin with ``pairs.NAME``
            are the longitude and the latitude of the axis of the pair NAME.
        """
        pairs_without_axis = [
            name
            for name, table in self._document.data["pairs"].items()
            if "through_xyz" in table or "through_lonlat" in table
        ]
        for name in pairs_without_axis:
            self.notes.append(
                f"no slider for the axis of {name}, which the file states by two "
                "directions of its arc; state it by lonlat to vary it"
            )
        tables_without_axis = [["pairs", name] for name in pairs_without_axis]
        return tuple(key for key in keys if key.split(".")[:2] not in tables_without_axis)

    # Whole turns and crossings

    @property
    def _wound_pairs(self) -> list[str]:
        """The passive pairs whose whole turns the page counts.

        These are the pairs (joints) on whose angle loads depend, such as pairs with a
        spring. No turns are counted with several inputs, or if assembly modes pass through
        crossings, because the count follows a mode with constant signs.
        """
        if len(self._inputs) > 1 or self._crossings == "pass":
            return []
        return [pair for pair in wound_pairs(self._mechanism) if pair not in self._inputs]

    def _turn_facts(self, pair: str) -> Facts:
        """Return what the page needs to count the whole turns of a passive pair (joint).

        Pair angles are computed in (-pi, pi]. Whole turns are added to them, so that an
        angle does not jump along an assembly mode (way to assemble the mechanism). At one
        value of the input, the `anchor`, no turns are added. If the input grows by the
        `period`, the mechanism has the same configurations again. Anchor and period are the
        same for all passive (not driven) pairs.

        Returns
        -------
        The name of the pair, the `anchor` (rad), and the `period` (rad), None if
        configurations never return.
        """
        (anchor,) = self._position_solver.anchor_inputs
        (period,) = self._position_solver.periods
        return {
            "pair": pair,
            "anchor": float(anchor),
            "period": float(period) if np.isfinite(period) else None,
        }

    def _reference_input(self) -> float | None:
        """Return the input (rad) of the reference pose, None if there is none in the range.

        A reference pose is a configuration for which the mechanism file gives the axes of
        all pairs.
        """
        solver = self._position_solver
        (input_value,) = solver.anchor_inputs
        (driven,) = self._mechanism.inputs
        low, high = driven.range
        if solver.reference is None or not low <= input_value <= high:
            return None
        return float(input_value)

    @cached_property
    def _position_solver(self) -> PositionSolver:
        """The position solver of the mechanism, with the sizes of the file."""
        return PositionSolver(self._mechanism, assembly_by_count_or_rank(self._mechanism))

    # Text of the page

    def make_model(
        self,
        shown_names: Sequence[str],
        computed_names: Iterable[str] = (),
        has_closed_form: bool = True,
    ) -> Facts:
        """Return the description of the mechanism that the scripts of the page read.

        Parameters
        ----------
        shown_names
            The quantities that have curves.
        computed_names
            The quantities that the page computes at every sample.
        has_closed_form
            Whether positions are computed in closed form, from the signs of dyads (two
            links with three R pairs). If not, modes are followed by steps of Newton's
            method, which cannot pass crossings.
        """
        mechanism = self._mechanism
        page_quantities = self._page_quantities
        passes_crossings = self._crossings == "pass" and has_closed_form
        # A smooth curve passes crossings, so it can belong to one assembly mode at some
        # inputs and to another mode at others. The scripts give it the number of the mode
        # to which it belongs at the `anchor`, if curves do not cross there.
        crossings = {"anchor": self._reference_input()} if passes_crossings else None
        moving_prefixes = (*LOAD_DEPENDENT_PREFIXES, "kinetic_energy")
        size_paths = [variable.path for variable in self._size_variables]
        return {
            "name": mechanism.name,
            "angle_unit": self._document.data["angle_unit"],
            "inputs": [input_facts(mechanism, driven) for driven in mechanism.inputs],
            "links": [link_facts(mechanism, link) for link in mechanism.links],
            "pairs": pair_facts(mechanism),
            "outputs": [
                {"name": output.name, "link": output.link, "direction": output.direction}
                for output in mechanism.outputs
            ],
            "sizes": [self._slider_facts(variable) for variable in self._size_variables],
            "quantities": [
                quantity_facts(mechanism, name, page_quantities.unit_by_name[name])
                for name in shown_names
            ],
            "coefficients": [
                page_quantities.output_coefficients(suffix)
                for suffix in page_quantities.input_suffixes
            ],
            "paths": [
                {"stem": path.vector, "link": path.link}
                for path in page_quantities.output_paths
            ],
            "stops": page_quantities.output_determinant,
            "signed": [
                {
                    "links": [pole.link, pole.reference],
                    "end": pole.input_suffix,
                    "names": names,
                }
                for pole, names in page_quantities.signed_quantities(computed_names).items()
            ],
            "limits": [
                {
                    "pair": joint_limit.pair,
                    "low": joint_limit.low,
                    "high": joint_limit.high,
                }
                for joint_limit in mechanism.joint_limits
            ],
            "wound": [self._turn_facts(pair) for pair in self._wound_pairs],
            "crossings": crossings,
            "moving": any(name.startswith(moving_prefixes) for name in shown_names),
            "plans": [
                plan_facts(pole_plan, suffix)
                for suffix, pole_plan in zip(
                    page_quantities.input_suffixes, self._pole_plans, strict=True
                )
            ],
            "toml": split_at_numbers(self._document, size_paths),
        }

    @cached_property
    def _size_variables(self) -> list[DesignVariable]:
        """The numbers of the file that have sliders."""
        return [design_variable(self._document, key) for key in self.keys]

    def _slider_facts(self, variable: DesignVariable) -> Facts:
        """Return the key, value and ranges of a slider, in the unit of the file.

        The entry "unit" is "rad" for all angles, also if the unit of the file is deg.
        """
        slider = slider_range(self._document, self._mechanism, variable)
        unit = "rad" if variable.is_angle else ""
        return {
            "key": variable.key,
            "value": variable.value,
            "unit": unit,
            **slider.facts(),
        }

    def _fill_page(self, model: Facts, kernels: str) -> str:
        """Return the whole text of the HTML page, from a template.

        Parameters
        ----------
        model
            The description of the mechanism that the scripts of the page read.
        kernels
            JavaScript functions that compute positions and quantities of the mechanism.
        """
        mechanism = self._mechanism
        citation = mechanism.source.citation if mechanism.source else ""
        return Template(_read_part("page.html")).substitute(
            title=html_text(mechanism.name),
            citation=html_text(citation),
            version=__version__,
            css=_read_part("parts/uplot.css") + _read_part("page.css"),
            # The legend explains joint limits only if there are some.
            limit_key=JOINT_LIMIT_KEY if mechanism.joint_limits else "",
            uplot=_read_part("parts/uplot.js"),
            model=json_text(model),
            kernels=kernels,
            scripts="\n".join(map(_read_part, SCRIPTS)),
        )


def _matches_any(name: str, patterns: Iterable[str]) -> bool:
    """Return whether a name matches one of several patterns, such as ``omega_*``."""
    return any(fnmatchcase(name, pattern) for pattern in patterns)


def _read_part(name: str) -> str:
    """Return a file of this package as text."""
    return files(__package__).joinpath(name).read_text("utf-8")


def _write_kernels(formulas_by_kernel: Mapping[str, Formulas]) -> str:
    """Return JavaScript code that defines the functions of several sets of formulas.

    The functions of a set are called a kernel. The exported code of a kernel defines
    ``NAME_about`` (a description of the formulas) and ``NAME`` (computes the results). If
    positions have no closed form, ``NAME_step`` is a step of Newton's method. The scripts
    of the page read them as `about`, `at` and `step` of an object for each kernel. Each
    kernel has a scope of its own, since all kernels define the same names.

    Parameters
    ----------
    formulas_by_kernel
        The formulas of each kernel, by the name of the kernel in the scripts of the page.
    """
    parts: list[str] = []
    for kernel, kernel_formulas in formulas_by_kernel.items():
        # The page is not a JavaScript module, so remove the word `export`.
        text = re.sub(r"^export ", "", source(kernel_formulas, "js"), flags=re.M)
        # NAME is read from the line "const NAME_about = ...".
        (name,) = re.findall(r"^const (\w+)_about\b", text, re.M)
        step = f"{name}_step" if kernel_formulas.step else "null"
        parts.append(
            f"{kernel}: (() => {{\n{text}\n"
            f"return {{about: {name}_about, at: {name}, step: {step}}};\n}})(),"
        )
    return "\n".join(["const KERNELS = {", *parts, "};"])
