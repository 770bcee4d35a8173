"""Figures and tables of many designs, in parts that are there whole or not at all.

Which designs there are: grids, lists, and sets that fill a space evenly.
"""

import hashlib
import json
import math
import re
import warnings
from collections import Counter
from collections.abc import Callable, Collection, Sequence
from dataclasses import asdict, dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, Literal

import numpy as np

from spherekit.analysis.contract import AbstractAnalysis, FigureOfMerit
from spherekit.analysis.folder import code_identity
from spherekit.analysis.frames import notes_of, part_tables, write_columns
from spherekit.analysis.running.run_state import identities_of
from spherekit.analysis.tables import Table, TableArrays, Units
from spherekit.arrays import Bools, Floats, Indices
from spherekit.conventions import AnyPath, Facts, Names, choices, listing
from spherekit.design.evaluate import Evaluator
from spherekit.design.figures import NEVER_CLOSES, DesignSamples, Evaluated
from spherekit.design.runs import ASSEMBLY, DesignRuns
from spherekit.design.variables import OK, DesignVariable, check_variables, design_variable
from spherekit.engine.row_quantities import row_quantities
from spherekit.errors import DesignError, ModelError, OutputError
from spherekit.files.atomic import make_folder, refused
from spherekit.files.document import Document
from spherekit.files.plain import as_json
from spherekit.model.expression import Expression, parse
from spherekit.model.mechanism import Mechanism
from spherekit.model.study import Study
from spherekit.processor import processor_identity
from spherekit.sphere.rotation import all_finite

Scheme = Literal["grid", "sobol", "latin", "random"]

SCHEMES: tuple[Scheme, ...] = ("grid", "sobol", "latin", "random")
"""All combinations; a scrambled Sobol sequence; Latin hypercube; independent, uniform."""

Values = Sequence[float] | tuple[float, float, int] | tuple[float, float]


@dataclass(frozen=True)
class Variation:
    """What a variable takes on: listed `values`, or all from `low` to `high`."""

    key: str
    low: float
    high: float
    values: tuple[float, ...] | None = None


def variation(key: str, given: str | Sequence[float]) -> Variation:
    """Return the variation over a list, or of ``10:40:31``, ``10:40`` or ``10,20,25``.

    Raises
    ------
    DesignError
        If it is none of these.
    """
    try:
        if isinstance(given, str) and ":" in given:
            low, high, *count = given.split(":")
            if not count:
                return between(key, float(low), float(high))
            (number,) = count
            values = np.linspace(float(low), float(high), int(number)).tolist()
        else:
            values = [*map(float, given.split(",") if isinstance(given, str) else given)]
    except ValueError:
        raise DesignError(
            f"{key}={given}: write LOW:HIGH:COUNT, such as 10:40:31, a list such as "
            "10,20,25, or LOW:HIGH for --designs"
        ) from None
    if not values or not all_finite(values):
        raise DesignError(f"{key}: give at least one value, and finite ones")
    return Variation(key, min(values), max(values), tuple(values))


def between(key: str, low: float, high: float) -> Variation:
    """Return a variation over a range."""
    if not -math.inf < low < high < math.inf:
        raise DesignError(
            f"{key}: {low:g} to {high:g} is no range; give the lower end first"
        )
    return Variation(key, low, high)


@dataclass(frozen=True)
class DesignSpace:
    """Designs by number, the same whenever and wherever they are asked for."""

    variations: tuple[Variation, ...]
    scheme: Scheme
    count: int
    seed: int

    @staticmethod
    def of(
        variations: Sequence[Variation],
        designs: int | None = None,
        scheme: Scheme | None = None,
        seed: int = 0,
    ) -> "DesignSpace":
        """Return the space of variations: their grid, or so many designs by a scheme.

        Raises
        ------
        DesignError
            If ranges have no count for a grid, or nothing is varied.
        """
        if not variations:
            raise DesignError("nothing is varied: give --vary KEY=LOW:HIGH:COUNT")
        chosen = scheme or ("grid" if designs is None else "sobol")
        if chosen not in SCHEMES:
            raise DesignError(
                f'scheme "{chosen}" is not known{choices(chosen, SCHEMES, "allowed")}'
            )
        if chosen == "grid":
            if designs is not None:
                raise DesignError(
                    "a grid has as many designs as combinations: leave out "
                    "the number of designs, or take sobol, latin or random"
                )
            for varied in variations:
                if varied.values is None:
                    raise DesignError(
                        f"{varied.key}: a grid needs how many values, "
                        f"{varied.key}={varied.low:g}:{varied.high:g}:11; "
                        "or give --designs N"
                    )
            designs = math.prod(len(item.values or ()) for item in variations)
        if designs is None or designs < 1:
            raise DesignError(f"{chosen}: give how many designs, at least 1")
        if seed < 0:
            raise DesignError(f"seed: found {seed}; a seed is a whole number from 0 on")
        return DesignSpace(tuple(variations), chosen, designs, seed)

    def designs(self, start: int, stop: int) -> Floats:
        """Return the designs from one number to before another, (variables, n)."""
        made = []
        unit = self._unit(start, min(stop, self.count))
        for varied, share in zip(self.variations, unit, strict=True):
            if varied.values is None:
                made.append(varied.low + (varied.high - varied.low) * share)
            else:
                values = np.array(varied.values)
                place = (share * len(values)).astype(int)
                made.append(values[np.minimum(place, len(values) - 1)])
        return np.stack(made)

    def _unit(self, start: int, stop: int) -> Floats:
        """Return points of the unit cube (variables, n)."""
        size = len(self.variations)
        if self.scheme == "grid":
            shape = [len(varied.values or ()) for varied in self.variations]
            places = np.unravel_index(np.arange(start, stop), shape)
            return (np.array(places) + 0.5) / np.reshape(shape, (-1, 1))
        from scipy.stats import qmc

        if self.scheme == "sobol":
            sobol = qmc.Sobol(size, scramble=True, rng=self.seed)
            if start:
                sobol.fast_forward(start)
            with warnings.catch_warnings():
                # A number that is no power of 2 costs balance only, which parts have not.
                warnings.simplefilter("ignore", UserWarning)
                made = sobol.random(stop - start)
        elif self.scheme == "latin":
            made = qmc.LatinHypercube(size, rng=self.seed).random(self.count)[start:stop]
        else:
            bits = np.random.PCG64(self.seed).advance(start * size)
            made = np.random.Generator(bits).random((stop - start, size))
        return np.transpose(made)


Columns = dict[str, Any]
"""The columns of rows by name."""

_COMPARED = re.compile(r"(<=|>=|<|>)")


@dataclass(frozen=True)
class Condition:
    """``less < more`` of two expressions; where a value is NaN it does not hold."""

    text: str
    less: Expression
    more: Expression
    equal: bool

    @property
    def names(self) -> frozenset[str]:
        """What it depends on."""
        return self.less.names | self.more.names

    def sides(self, columns: Columns) -> tuple[Floats, Floats]:
        """Return what is to be less, and more, in rows (n,) with columns by name."""
        less, more = (
            side.evaluate({name: columns[name] for name in side.names})
            for side in (self.less, self.more)
        )
        return less, more

    def holds(self, columns: Columns) -> Bools:
        """Return for which rows it holds, from columns (n,) by name."""
        with np.errstate(invalid="ignore"):
            return (np.less_equal if self.equal else np.less)(*self.sides(columns))


def condition(text: str, names: Collection[str]) -> Condition:
    """Return the condition that a text states.

    Raises
    ------
    DesignError
        If it is no comparison, or of other names.
    """
    parts = _COMPARED.split(text)
    if len(parts) != 3:
        raise DesignError(
            f'"{text}" is no condition: write one comparison, such as '
            "links_2_arc < links_4_arc; give several one by one"
        )
    left, sign, right = parts
    try:
        sides = parse(left, names), parse(right, names)
    except ModelError as problem:
        raise DesignError(f'"{text}": {problem}') from None
    less, more = sides if sign[0] == "<" else sides[::-1]
    return Condition(text, less, more, sign[1:] == "=")


OWN = ("design", "mode", ASSEMBLY, "status", "reason", "closes", "claim", "grashof")
"""Columns that every table may have."""

GONE_THROUGH = (
    "samples",
    "grid",
    "path",
    "assembly_mode",
    "search",
    "laws",
    "duration",
    "start",
    "torque",
    "tolerance",
    "crossings",
    "verify",
)
"""What of a study says which numbers its runs have."""

DESIGNS = "designs"
TABLES = "tables"
"""Folders of the table of designs, where there are others, and of these."""

SWEEP = "sweep"
PART = "part"
PROCESSOR = "processor"
"""Notes of the files of a part: of which sweep, its number, and what computed it."""


@dataclass(frozen=True)
class Sweep:
    """Designs of one topology, and the figures of merit that are wanted of each.

    Attributes
    ----------
    mechanism, samples
        The mechanism, and the samples of figures that kernels compute, None without such.
    document
        The file whose numbers are varied.
    space
        Which designs there are.
    merits
        The figures of merit.
    where
        Conditions on designs and figures; what does not meet them is left out.
    study, analyses
        What each design is run through, None if none is run, and the analyses of that.
    tables
        Whether all tables of these runs are wanted.
    mode_labels
        What the only assembly mode that is wanted may be called in the column ``mode``;
        empty if all modes are wanted.
    """

    mechanism: Mechanism
    samples: DesignSamples | None
    document: Document
    space: DesignSpace
    merits: tuple[FigureOfMerit, ...]
    where: Names = ()
    study: Study | None = None
    analyses: tuple[AbstractAnalysis, ...] = ()
    tables: bool = False
    mode_labels: Names = ()

    def __post_init__(self) -> None:
        if not self.merits and not self.tables:
            raise DesignError(
                f"{self.mechanism.name}: no figure of merit is asked for: give --reduce, "
                "or an analysis with figures of its own; quantities of a row: "
                f"{listing(row_quantities(self.mechanism), 40)}"
            )
        check_variables(self.document, self.variables)
        names = [*OWN, *self.names]
        double = [name for k, name in enumerate(names) if name in names[:k]]
        if double:
            raise DesignError(
                f'{self.mechanism.name}: two columns would be called "{double[0]}"; give '
                "the figure of merit another name: NAME=REDUCTION(EXPRESSION)"
            )
        _ = self.conditions

    def __getstate__(self) -> Facts:
        kept = {**self.__dict__}
        kept.pop("evaluator", None)  # compiled kernels stay in their process
        kept.pop("identity", None)  # another process may have other versions
        return kept

    @cached_property
    def variables(self) -> tuple[DesignVariable, ...]:
        """What is varied."""
        return tuple(design_variable(self.document, v.key) for v in self.space.variations)

    @property
    def names(self) -> list[str]:
        """What is varied and the figures of merit, as tables and expressions call them."""
        return [x.name for x in self.variables] + [merit.name for merit in self.merits]

    @cached_property
    def conditions(self) -> tuple[Condition, ...]:
        """What designs have to meet."""
        names = ["closes", *self.names]
        return tuple(condition(text, names) for text in self.where)

    @cached_property
    def evaluator(self) -> Evaluator | DesignRuns:
        """What computes the figures; made once in a process."""
        of_kernel = None
        if self.samples is not None:
            merits = [merit for merit in self.merits if not merit.table]
            of_kernel = Evaluator(
                self.document, self.mechanism, self.variables, merits, self.samples
            )
        if self.study is None:
            assert of_kernel is not None
            return of_kernel
        return DesignRuns(
            self.document,
            self.study,
            self.variables,
            [merit for merit in self.merits if merit.table],
            self.analyses,
            self.tables,
            of_kernel,
        )

    @property
    def angle(self) -> str:
        """The file's unit of angles, in which all angles of the table are."""
        return str(self.document.data["angle_unit"])

    @cached_property
    def part_size(self) -> int:
        """Designs in a part."""
        return self.evaluator.part(self.space.count)

    @property
    def parts(self) -> int:
        """How many parts there are."""
        return -(-self.space.count // self.part_size)

    def definition(self) -> Facts:
        """Return what the sweep is of, as it stands in its folder."""
        text = json.dumps(as_json(self.document.data), sort_keys=True)
        return code_identity() | {
            "mechanism": self.mechanism.name,
            "file": hashlib.sha256(text.encode()).hexdigest(),
            "input": ", ".join(self.mechanism.input_pairs),
            "samples": hashlib.sha256(self._sampled).hexdigest(),
            "angle_unit": self.angle,
            "vary": [asdict(variation) for variation in self.space.variations],
            "scheme": self.space.scheme,
            "designs": self.space.count,
            "seed": self.space.seed,
            "merits": [asdict(merit) for merit in self.merits],
            "where": self.where,
            "mode_labels": self.mode_labels,
            "part": self.part_size,
            "columns": OWN,
            "analyses": identities_of(self.analyses),
            "tables": self.tables,
            "degrees": self.degrees,
        }

    @cached_property
    def identity(self) -> str:
        """The SHA-256 sum of the definition, which the files of every part carry."""
        text = json.dumps(as_json(self.definition()), sort_keys=True)
        return hashlib.sha256(text.encode()).hexdigest()

    def part_notes(self, number: int) -> Facts:
        """Return the notes by which a file is known as that of a part of this sweep."""
        return {SWEEP: self.identity, PART: number}

    @property
    def degrees(self) -> bool:
        """Whether tables have angles in degrees."""
        return self.study is not None and self.study.degrees

    @property
    def _sampled(self) -> bytes:
        sampled = b"" if self.samples is None else self.samples.rows.tobytes()
        study = self.study
        if study is None:
            return sampled
        through = [study.mechanism.inputs, *(getattr(study, name) for name in GONE_THROUGH)]
        with np.printoptions(threshold=2**62, floatmode="unique"):
            return sampled + repr(through).encode()

    def _unit(self, merit: FigureOfMerit) -> str:
        evaluator = self.evaluator
        if merit.table:
            assert isinstance(evaluator, DesignRuns)
            return merit.unit(evaluator.units[merit.name])
        return merit.unit(row_quantities(self.mechanism))

    def units(self) -> Units:
        """Return the unit of every column that has one."""
        made = {
            variable.name: self.angle for variable in self.variables if variable.is_angle
        }
        made |= {merit.name: self._unit(merit) for merit in self.merits}
        return {name: self.angle if unit == "rad" else unit for name, unit in made.items()}

    def part(
        self,
        number: int,
        take: Callable[[int, str, Table, TableArrays], None] | None = None,
    ) -> Columns:
        """Return the rows of a part: designs in order, each in its assembly modes.

        `take` takes the tables of those that have a row left, see `part_tables`.
        """
        start = number * self.part_size
        designs = self.space.designs(start, start + self.part_size)
        rows = np.flatnonzero(self._hold(self._numbers(designs), designs.shape[1]))
        designs = designs[:, rows]
        rows = start + rows
        evaluator = self.evaluator
        if not isinstance(evaluator, DesignRuns):
            return self._meeting(self.rows(designs, rows))
        pieces = [self._shown(designs, rows, Evaluated.of([], evaluator.names))]
        for evaluated, of_run in evaluator.runs_of(designs, self._worth_running):
            made = self._meeting(self._shown(designs, rows, evaluated))
            pieces.append(made)
            if take is not None and len(made["design"]):
                for stem, table, data in of_run:
                    take(int(made["design"][0]), stem, table, data)
        return {name: np.concatenate([p[name] for p in pieces]) for name in pieces[0]}

    def _numbers(self, designs: Floats) -> Columns:
        """Return what is varied of designs (variables, n), by name."""
        return dict(zip([v.name for v in self.variables], designs, strict=True))

    def _meeting(self, made: Columns) -> Columns:
        """Return the rows that meet the conditions."""
        holds = self._hold(made, len(made["design"]))
        return {name: values[holds] for name, values in made.items()}

    def rows(self, designs: Floats, numbers: Indices) -> Columns:
        """Return the rows of designs (variables, n), by their numbers, in all modes."""
        return self._shown(designs, numbers, self.evaluator.at(designs))

    def _shown(self, designs: Floats, numbers: Indices, evaluated: Evaluated) -> Columns:
        """Return the rows of designs with their numbers and classes, in the file's unit."""
        if self.mode_labels:
            evaluated = self._rows_of_wanted_mode(evaluated)
        design = evaluated.design
        classes = self.evaluator.classes(designs[:, design])
        made = {"design": numbers[design], **self._numbers(designs[:, design])}
        made["mode"] = evaluated.mode
        if self.tables:
            made[ASSEMBLY] = evaluated.merits[ASSEMBLY]
        made |= {
            "status": evaluated.status,
            "closes": evaluated.closes,
            "claim": evaluated.claim,
        }
        if classes is not None:
            there = np.isin(evaluated.status, [OK, NEVER_CLOSES])
            made["grashof"] = np.where(there, classes, "").astype(object)
        return made | self._in_file_units(evaluated) | {"reason": evaluated.reason}

    def _rows_of_wanted_mode(self, evaluated: Evaluated) -> Evaluated:
        """Return the rows of the only mode wanted, also of designs that do not have it."""
        # Rows without a mode are those of designs that fail as a whole.
        kept = evaluated.rows(np.isin(evaluated.mode, ["", *self.mode_labels]))
        missing = Evaluated.of(
            np.setdiff1d(evaluated.design, kept.design),
            list(evaluated.merits),
            self.mode_labels[0],
            status=NEVER_CLOSES,
            reason="does not close in this assembly mode at any sample",
        )
        return Evaluated.in_order([kept, missing], list(evaluated.merits))

    def _in_file_units(self, evaluated: Evaluated) -> Columns:
        """Return the figures that there are, single angles in the file's unit."""
        made: Columns = {}
        for merit in self.merits:
            if merit.name in evaluated.merits:
                values = evaluated.merits[merit.name]
                is_angle = self.angle == "deg" and self._unit(merit) == "rad"
                made[merit.name] = np.degrees(values) if is_angle else values
        return made

    def _hold(self, columns: Columns, n: int) -> Bools:
        """Return in which rows (n,) all conditions hold that are of these columns."""
        decided = [item for item in self.conditions if item.names <= columns.keys()]
        every = [np.broadcast_to(item.holds(columns), n) for item in decided]
        return np.all([np.ones(n, bool), *every], axis=0)

    def path_of(self, folder: AnyPath, number: int) -> Path:
        """Return the path of a part of the table of designs."""
        return (
            Path(folder) / (DESIGNS if self.tables else "") / f"part-{number:06d}.parquet"
        )

    def files_of(self, folder: AnyPath, number: int) -> list[Path]:
        """Return the files of a part; none unless all of them are there.

        That of the designs is written last, and says which others there are.

        Raises
        ------
        OutputError
            If a file of its name is there that is none of this part.
        """
        path = self.path_of(folder, number)
        if not path.exists():
            return []
        stems = self.notes_of_part(folder, number)[TABLES]
        paths = [path, *(Path(folder) / TABLES / stem / path.name for stem in stems)]
        return paths if all(made.exists() for made in paths) else []

    def notes_of_part(self, folder: AnyPath, number: int) -> Facts:
        """Return the notes of a part that is there: the rows of its tables, its processor.

        Raises
        ------
        OutputError
            If a file of its name is there that is none of this part.
        """
        path = self.path_of(folder, number)
        notes = notes_of(path)
        if not self.part_notes(number).items() <= notes.items():
            raise OutputError(
                f"{path}: is not part {number} of this sweep: another program or another "
                "sweep has written it; move it away, and the same command makes the part"
            )
        return notes

    def _worth_running(self, design: Floats, rows: Evaluated) -> bool:
        """Return whether a design (variables,) meets the conditions on kernel figures."""
        columns = self._numbers(design) | self._in_file_units(rows)
        return bool(np.any(self._hold(columns, len(rows.design))))

    def write(self, folder: str, number: int) -> int:
        """Write a part, and return its number."""
        path = self.path_of(folder, number)
        make_folder(path.parent)
        rows = Counter[str]()
        place = Path(folder) / TABLES
        identification = self.part_notes(number)
        with part_tables(place, path.name, self.degrees, rows, identification) as take:
            columns = self.part(number, take)
        notes = {"units": self.units(), TABLES: rows, PROCESSOR: processor_identity()}
        write_columns(path, columns, notes | identification)
        return number

    def settle(self, made: str, folder: Path, number: int) -> int:
        """Move the files of a part from where they were made; return their bytes.

        Raises
        ------
        OutputError
            If they are not there, or cannot be moved.
        """
        paths = self.files_of(made, number)
        if not paths:
            raise OutputError(
                f"{folder}: part {number} was computed, and is not in {made}: something "
                "has removed it; the same command makes it again"
            )
        for path in reversed(paths):
            target = folder / path.relative_to(made)
            make_folder(target.parent)
            try:
                path.replace(target)
            except OSError as error:
                raise refused(target, "written", error) from None
        return sum(path.stat().st_size for path in self.files_of(folder, number))
