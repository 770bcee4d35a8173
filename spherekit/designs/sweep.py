"""The task of a sweep: figures of merit and tables of many designs of one mechanism.

A *design* is the mechanism of a file in which some numbers have other values. The designs
of a sweep form a *design space*: all combinations of listed values, or points that a random
or quasi-random sequence places in ranges. They are numbered from 0.

Designs are computed in *parts*. A part is a group of designs with successive numbers, and
parts are numbered from 0, too. Each part is written to files of its own: one with its rows
of the table of designs, and one for each table of the runs of its designs. A part is
complete when all its files are there.

`sweep_parts` computes the parts of a sweep, and `design_space` the values of the designs.
"""

import hashlib
import json
from collections import Counter
from collections.abc import Callable
from dataclasses import asdict, dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from spherekit.arrays import Bools, Floats, Indices
from spherekit.conventions import AnyPath, Facts, Names
from spherekit.designs.design_conditions import Columns, Condition, parse_condition
from spherekit.designs.design_evaluation import DesignEvaluator
from spherekit.designs.design_runs import ASSEMBLY, DesignRuns
from spherekit.designs.design_space import DesignSpace
from spherekit.designs.design_variables import (
    OK,
    DesignVariable,
    check_variables,
    design_variable,
)
from spherekit.designs.figures_of_merit import NEVER_CLOSES, DesignSamples, DesignTable
from spherekit.errors import DesignError, OutputError
from spherekit.files.study import Study
from spherekit.files.toml_document import Document
from spherekit.files.units import angle_paths
from spherekit.mechanism.mechanism import Mechanism
from spherekit.processor import processor_identity
from spherekit.runs.contract import AbstractAnalysis
from spherekit.runs.figure_of_merit import FigureOfMerit
from spherekit.runs.run_identity import code_identity
from spherekit.runs.run_state import describe_analyses
from spherekit.storage.atomic_write import make_folder, output_error
from spherekit.storage.json_data import as_json
from spherekit.tables.table import Table, TableArrays, Units
from spherekit.tables.table_files import open_part_tables, read_notes, write_columns
from spherekit.velocities.row_quantities import row_quantities
from spherekit.wording import listing

GENERAL_COLUMNS = (
    "design",
    "mode",
    ASSEMBLY,
    "status",
    "reason",
    "closes",
    "claim",
    "grashof",
)
"""Columns that a table of designs may have besides variables and figures of merit."""

SAMPLING_FIELDS = (
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
"""Fields of a study on which the numbers in the tables of its runs depend."""

DESIGNS_FOLDER = "designs"
"""Folder of the table of designs if there are also tables of runs.

Otherwise this table is in the folder of the sweep itself.
"""

TABLES_FOLDER = "tables"
"""Folder that has a folder for each table of runs."""

SWEEP_NOTE = "sweep"
"""Note (metadata) in the files of parts: the `Sweep.identity`."""

PART_NOTE = "part"
"""Note in the files of parts: the number of the part."""

ROW_COUNTS_NOTE = "tables"
"""Note in the table of designs: the number of rows of each table of runs, by its name."""

PROCESSOR_NOTE = "processor"
"""Note in the table of designs: the `processor_identity` of the computing process."""


@dataclass(frozen=True)
class Sweep:
    """The task to compute figures of merit (numbers that rate a design) of many designs.

    A design is the mechanism of a file in which some numbers have other values. A figure is
    computed from samples by compiled functions (kernels), or from tables of a run of the
    design.

    Attributes
    ----------
    mechanism, samples
        The mechanism, and the samples of the inputs at which compiled kernels evaluate
        figures of merit. `samples` is None if no figure is computed in this way.
    document
        The mechanism file whose numbers are varied.
    space
        The designs: the numbers that vary and their values.
    merits
        The figures of merit.
    where
        Conditions on variables and figures, such as ``"links_2_arc < links_4_arc"``. Rows
        (assembly modes of designs) that do not meet all of them are left out.
    study, analyses
        The study by which each design is run, and its analyses. `study` is None if no
        design is run.
    tables
        Whether all tables of the runs are stored.
    mode_labels
        The possible labels, in the column ``mode``, of the only assembly mode that is
        requested. Empty if all modes are requested.

    Raises
    ------
    DesignError
        If there is nothing to compute, a variable or condition is invalid, or two columns
        have the same name.
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
        """Check the definition of the sweep, which evaluates many designs of a mechanism.

        A design is one choice of some numbers, and a figure of merit is a number that rates
        it. There must be something to compute, and all columns need different names.

        Raises
        ------
        DesignError
            If there is no figure of merit, if a number cannot be varied, if two columns
            have the same name, or if a condition cannot be parsed.
        """
        # A run can compute tables for each design. `tables` says whether they are stored.
        has_results = self.merits or self.tables
        if not has_results:
            quantities = row_quantities(self.mechanism)
            last_angle = [name for name in quantities if name.startswith("theta_")][-1]
            raise DesignError(
                f"{self.mechanism.name}: no figure of merit is requested; add an analysis "
                "that defines some, such as -a poles, or an expression of your own, such "
                f'as --reduce "swing=swing({last_angle})". Quantities: '
                f"{listing(quantities, 20)}"
            )
        check_variables(self.document, self.variables)
        # `self.names` are the columns of the variables and of the figures.
        names = [*GENERAL_COLUMNS, *self.names]
        repeated = [name for k, name in enumerate(names) if name in names[:k]]
        if repeated:
            raise DesignError(
                f"{self.mechanism.name}: two columns of the table of designs would be "
                f'called "{repeated[0]}"; give the figure of merit another name, as in '
                "NAME=REDUCTION(EXPRESSION)"
            )
        # The property parses the conditions, and raises an error if one is faulty.
        _ = self.conditions

    def __getstate__(self) -> Facts:
        """Return the state to pickle, without what another process computes itself."""
        remaining = {**self.__dict__}
        remaining.pop("evaluator", None)  # compiled kernels stay in their process
        remaining.pop("identity", None)  # another process may have other versions
        return remaining

    @cached_property
    def variables(self) -> tuple[DesignVariable, ...]:
        """The numbers of the file that are varied, in the order of the design arrays."""
        return tuple(design_variable(self.document, v.key) for v in self.space.variations)

    @property
    def names(self) -> list[str]:
        """Column names of the variables, followed by the names of the figures of merit."""
        return [x.name for x in self.variables] + [merit.name for merit in self.merits]

    @cached_property
    def conditions(self) -> tuple[Condition, ...]:
        """The conditions that rows of the result must meet, read from the texts of `where`.

        A row is one assembly mode of one design. A condition compares two expressions, such
        as ``"links_2_arc < links_4_arc"``.

        Raises
        ------
        DesignError
            If a condition is no comparison, or uses an unknown name.
        """
        names = ["closes", *self.names]
        return tuple(parse_condition(text, names) for text in self.where)

    @cached_property
    def evaluator(self) -> DesignEvaluator | DesignRuns:
        """The object that computes the figures of merit (numbers that rate a design).

        There are two kinds of figures:

        - Some follow from quantities at samples of the inputs, such as an angle. A
          `DesignEvaluator` computes them for many designs at once.
        - Others follow from result tables of analyses, which are run for each design. A
          study says what is run. `DesignRuns` computes the two kinds, with a
          `DesignEvaluator` for the first kind.
        """
        kernel_evaluator = None
        # `samples` is None if no figure follows from quantities at samples.
        if self.samples is not None:
            merits = [merit for merit in self.merits if not merit.table]
            kernel_evaluator = DesignEvaluator(
                self.document,
                self.mechanism,
                self.variables,
                merits,
                self.samples,
                # The only wanted assembly mode is given by the labels that a run gives it.
                # So the evaluator has to label modes as a run does.
                needs_modes_of_runs=bool(self.mode_labels),
            )
        if self.study is None:
            # A sweep without a study has samples.
            assert kernel_evaluator is not None
            return kernel_evaluator
        return DesignRuns(
            self.document,
            self.study,
            self.variables,
            [merit for merit in self.merits if merit.table],
            self.analyses,
            self.tables,
            kernel_evaluator,
        )

    @property
    def angle(self) -> str:
        """Unit of angles in the file and the table of designs, ``"deg"`` or ``"rad"``."""
        return str(self.document.data["angle_unit"])

    @cached_property
    def part_size(self) -> int:
        """Number of designs in a part; the last part may have fewer."""
        return self.evaluator.part_size(self.space.count)

    @property
    def part_count(self) -> int:
        """Number of parts."""
        # -(-a // b) is a / b rounded up.
        return -(-self.space.count // self.part_size)

    def definition(self) -> Facts:
        """Return everything on which the results of the sweep depend, by name.

        A sweep evaluates many designs of a mechanism, in numbered parts. The definition is
        stored in the folder of the sweep. Before a sweep continues in a folder, its
        definition is compared with the stored one. Versions of the software are included.
        Checksums represent long contents, such as the file and the samples.
        """
        text = json.dumps(as_json(self.document.data), sort_keys=True)
        return code_identity() | {
            "mechanism": self.mechanism.name,
            "file": hashlib.sha256(text.encode()).hexdigest(),
            "input": ", ".join(self.mechanism.input_pairs),
            "samples": hashlib.sha256(self._sampling_bytes).hexdigest(),
            "crossings": None if self.samples is None else self.samples.crossings,
            "search": self.searches_modes,
            "angle_unit": self.angle,
            "vary": [
                {
                    "key": variation.key,
                    "low": variation.low,
                    "high": variation.high,
                    "values": variation.values,
                }
                for variation in self.space.variations
            ],
            "scheme": self.space.scheme,
            "designs": self.space.count,
            "seed": self.space.seed,
            "merits": [asdict(merit) for merit in self.merits],
            # Conditions that rows of the result must meet.
            "where": self.where,
            # Labels of the requested assembly mode (way to assemble the mechanism).
            "mode_labels": self.mode_labels,
            "part": self.part_size,
            "columns": GENERAL_COLUMNS,
            "analyses": describe_analyses(self.analyses),
            # Whether the tables of the analyses are stored, and whether in degrees.
            "tables": self.tables,
            "degrees": self.degrees,
        }

    @cached_property
    def identity(self) -> str:
        """SHA-256 checksum of the definition of the sweep, as a hexadecimal text.

        The files of the result contain this checksum. When a sweep is continued, files of
        another sweep are recognized by it.
        """
        text = json.dumps(as_json(self.definition()), sort_keys=True)
        return hashlib.sha256(text.encode()).hexdigest()

    def part_notes(self, number: int) -> Facts:
        """Return the notes that identify a file as part `number` of this sweep."""
        return {SWEEP_NOTE: self.identity, PART_NOTE: number}

    @property
    def searches_modes(self) -> bool:
        """Whether assembly modes other than that of a reference pose are searched."""
        sources = (self.samples, self.study)
        return all(source is None or source.search for source in sources)

    @property
    def degrees(self) -> bool:
        """Whether the tables of runs have angles in degrees."""
        return self.study is not None and self.study.degrees

    @property
    def _sampling_bytes(self) -> bytes:
        """All samples and settings of the runs, as bytes for a checksum."""
        sampling_bytes = b"" if self.samples is None else self.samples.rows.tobytes()
        study = self.study
        if study is None:
            return sampling_bytes
        sampling_settings = [
            study.mechanism.inputs,
            *(getattr(study, name) for name in SAMPLING_FIELDS),
        ]
        # NumPy must print all elements of an array with all their digits.
        with np.printoptions(threshold=2**62, floatmode="unique"):
            return sampling_bytes + repr(sampling_settings).encode()

    def _unit(self, merit: FigureOfMerit) -> str:
        """Return the unit of a figure of merit as it is computed (rad and SI)."""
        evaluator = self.evaluator
        if merit.table:
            assert isinstance(evaluator, DesignRuns)
            return merit.unit(evaluator.units[merit.name])
        return merit.unit(row_quantities(self.mechanism))

    def units(self) -> Units:
        """Return the units of angles that vary (the file's unit) and of figures of merit.

        The unit of a figure is empty if it is not known.
        """
        angles = angle_paths(self.document)
        units = {
            variable.name: self.angle
            for variable in self.variables
            if variable.is_angle or variable.path in angles
        }
        units |= {merit.name: self._unit(merit) for merit in self.merits}
        # Figures in rad are converted to the unit of the file.
        return {name: self.angle if unit == "rad" else unit for name, unit in units.items()}

    def compute_part(
        self,
        number: int,
        store_table: Callable[[int, str, Table, TableArrays], None] | None = None,
    ) -> Columns:
        """Compute the table of designs of one part of a sweep.

        A sweep evaluates many designs of a mechanism. A part is a group of designs with
        successive numbers.

        Parameters
        ----------
        number
            Number of the part, counted from 0.
        store_table
            Function that stores a result table of the run of one design. Its arguments are
            the number of the design, the name of the table, its description and its
            columns. By default the tables are not stored.

        Returns
        -------
        The columns by name. Each row is one design in one assembly mode (way to assemble
        the mechanism), ordered by design. Designs and rows that do not meet the conditions
        of the sweep (`where`) are left out.
        """
        start = number * self.part_size
        designs = self.space.compute_designs(start, start + self.part_size)
        # Designs that violate conditions on variables need not be computed.
        meets_conditions = self._meet_conditions(
            self._variable_columns(designs), designs.shape[1]
        )
        numbers = start + np.flatnonzero(meets_conditions)
        designs = designs[:, meets_conditions]
        if isinstance(self.evaluator, DesignRuns):
            return self._run_designs(self.evaluator, designs, numbers, store_table)
        # A `DesignEvaluator` runs no analyses, so there are no tables to store.
        return self._select_rows(self.tabulate_designs(designs, numbers))

    def _run_designs(
        self,
        design_runs: DesignRuns,
        designs: Floats,
        numbers: Indices,
        store_table: Callable[[int, str, Table, TableArrays], None] | None,
    ) -> Columns:
        """Compute the table of designs by running the analyses of each design.

        A figure of merit is a number that rates a design. Some figures need no run. If
        these figures violate the conditions of the sweep (`where`), the design is not run.

        Parameters
        ----------
        design_runs
            Runs the analyses.
        designs
            (variables, n) values of the design variables, in the units of the file.
        numbers
            (n,) number of each design.
        store_table
            Function that stores a table of a run, as for `compute_part`, or None.

        Returns
        -------
        The columns of all rows that meet the conditions, by name.
        """
        # Start with a table without rows, so that the result has columns in any case.
        no_rows = DesignTable.from_columns([], design_runs.names)
        columns_by_design = [self._as_columns(designs, numbers, no_rows)]
        runs = design_runs.run_designs(designs, self._worth_running)
        for design_table, run_tables in runs:
            columns = self._as_columns(designs, numbers, design_table)
            columns = self._select_rows(columns)
            columns_by_design.append(columns)
            has_rows = len(columns["design"]) > 0
            if store_table is not None and has_rows:
                # All rows have the number of this design.
                design_number = int(columns["design"][0])
                for table_name, table, data in run_tables:
                    store_table(design_number, table_name, table, data)
        return {
            name: np.concatenate([columns[name] for columns in columns_by_design])
            for name in columns_by_design[0]
        }

    def _variable_columns(self, designs: Floats) -> Columns:
        """Return the variables of designs (variables, n) as columns (n,) by name."""
        return dict(zip([v.name for v in self.variables], designs, strict=True))

    def _select_rows(self, columns: Columns) -> Columns:
        """Return the rows of a table, given as columns, that meet all conditions."""
        is_met = self._meet_conditions(columns, len(columns["design"]))
        return {name: values[is_met] for name, values in columns.items()}

    def tabulate_designs(self, designs: Floats, numbers: Indices) -> Columns:
        """Compute the table of some designs (choices of numbers of the mechanism).

        The table also has designs and rows that violate the conditions of the sweep.
        `compute_part` returns a table without them.

        Parameters
        ----------
        designs
            (variables, n) values of the design variables, in the units of the file.
        numbers
            (n,) number of each design.

        Returns
        -------
        The columns by name. Each row is one design in one assembly mode (way to assemble
        the mechanism).
        """
        return self._as_columns(designs, numbers, self.evaluator.evaluate(designs))

    def _as_columns(
        self, designs: Floats, numbers: Indices, design_table: DesignTable
    ) -> Columns:
        """Return the table of designs as columns, from computed figures of merit.

        A figure of merit is a number that rates a design. The columns have the numbers of
        the design, its mode, its status and the figures.

        Parameters
        ----------
        designs
            (variables, n) values of the design variables, in the units of the file.
        numbers
            (n,) number of each design in the whole sweep.
        design_table
            Rows of these designs, one for each assembly mode (way to assemble the
            mechanism). `DesignTable.design` is an index from 0 to n - 1.

        Returns
        -------
        The columns by name, with angles in the unit of the file. If the sweep is for one
        assembly mode only, the rows of other assembly modes are left out.
        """
        # `mode_labels` is empty if all modes are requested.
        if self.mode_labels:
            design_table = self._rows_of_wanted_mode(design_table)
        # The index of the design of each row.
        design = design_table.design
        row_designs = designs[:, design]
        grashof_classes = self.evaluator.grashof_classes(row_designs)
        columns = {"design": numbers[design], **self._variable_columns(row_designs)}
        columns["mode"] = design_table.mode
        # `tables` are result tables of the run of each design, in other files. There, an
        # assembly mode is identified by its number in the run. So the number is added here.
        if self.tables:
            columns[ASSEMBLY] = design_table.merits[ASSEMBLY]
        columns["status"] = design_table.status
        # `closes` is the fraction of the samples at which the mechanism can be assembled,
        # and `claim` is the guarantee that no assembly mode was missed.
        columns["closes"] = design_table.closes
        columns["claim"] = design_table.claim
        # A four-bar has a Grashof class: which of its links turn fully. The class is left
        # empty if sizes are invalid or the computation failed. Sizes with which the
        # mechanism cannot be assembled have a class.
        if grashof_classes is not None:
            has_class = np.isin(design_table.status, [OK, NEVER_CLOSES])
            columns["grashof"] = np.where(has_class, grashof_classes, "").astype(object)
        columns |= self._in_file_units(design_table)
        columns["reason"] = design_table.reason
        return columns

    def _rows_of_wanted_mode(self, design_table: DesignTable) -> DesignTable:
        """Return only the rows of the assembly mode that the user has chosen.

        An assembly mode is one way to assemble the mechanism. A design that cannot be
        assembled in this mode gets one row. Its status is `NEVER_CLOSES`, and its figures
        of merit (numbers that rate a design) are NaN. Rows of working modes (ways to
        assemble it at a fixed pose of the output) belong to no assembly mode and remain.
        """
        # A mode can have several labels, such as "0" and its signs "+-". `mode_labels` has
        # all labels of the wanted mode. A row with an empty label is for all modes, such as
        # the row of a design that failed.
        has_wanted_label = np.isin(design_table.mode, ["", *self.mode_labels])
        is_working_mode = design_table.is_working_mode
        remaining = design_table.rows(is_working_mode | has_wanted_label)
        figure_names = list(design_table.merits)
        # A row for each design of which only rows of other assembly modes were found.
        of_assembly_modes = design_table.rows(~is_working_mode)
        of_wanted_mode = design_table.rows(~is_working_mode & has_wanted_label)
        missing = DesignTable.from_columns(
            design=np.setdiff1d(of_assembly_modes.design, of_wanted_mode.design),
            merits=figure_names,
            mode=self.mode_labels[0],
            status=NEVER_CLOSES,
            reason="does not close in this assembly mode at any sample",
        )
        return DesignTable.join_by_design([remaining, missing], figure_names)

    def _in_file_units(self, design_table: DesignTable) -> Columns:
        """Return the columns (rows,) of figures of merit by name, in units of the file.

        A row is one assembly mode of one design. A figure in rad is converted to degrees if
        the file has degrees. Compound units such as rad/s are not converted.
        """
        columns: Columns = {}
        for merit in self.merits:
            if merit.name in design_table.merits:
                values = design_table.merits[merit.name]
                is_angle = self.angle == "deg" and self._unit(merit) == "rad"
                columns[merit.name] = np.degrees(values) if is_angle else values
        return columns

    def _meet_conditions(self, columns: Columns, n: int) -> Bools:
        """Return a mask (n,) of the rows of a table of designs that meet the conditions.

        `columns` has the numbers (n,) by name. Conditions on columns that are not computed
        yet are not checked.
        """
        applicable = [item for item in self.conditions if item.names <= columns.keys()]
        results = [np.broadcast_to(item.find_met(columns), n) for item in applicable]
        return np.all([np.ones(n, bool), *results], axis=0)

    def path_of(self, folder: AnyPath, number: int) -> Path:
        """Return the path of the file with the table of designs of a part."""
        designs_folder = Path(folder)
        if self.tables:
            designs_folder = designs_folder / DESIGNS_FOLDER
        return designs_folder / f"part-{number:06d}.parquet"

    def files_of(self, folder: AnyPath, number: int) -> list[Path]:
        """Return the paths of all files of a part, or an empty list if one is missing.

        A sweep evaluates many designs of a mechanism, in numbered parts. A part has a file
        with the table of designs. It may also have files with result tables of the run of
        each design. The table of designs is written last, and lists the other files.

        Parameters
        ----------
        folder
            Folder of the parts.
        number
            Number of the part.

        Returns
        -------
        The path of the table of designs, followed by the paths of the tables of runs.

        Raises
        ------
        FileError
            If the file of the table of designs cannot be read.
        OutputError
            If that file belongs to another sweep, or to another part.
        """
        path = self.path_of(folder, number)
        if not path.exists():
            return []
        # The number of rows of each table of runs, by its name. Each such table has a
        # folder with one file for each part.
        row_counts = self.notes_of_part(folder, number)[ROW_COUNTS_NOTE]
        tables_folder = Path(folder) / TABLES_FOLDER
        paths = [path]
        for table_name in row_counts:
            paths.append(tables_folder / table_name / path.name)
        return paths if all(part_file.exists() for part_file in paths) else []

    def notes_of_part(self, folder: AnyPath, number: int) -> Facts:
        """Read the notes (metadata) of the file with the table of designs of a part.

        A sweep evaluates many designs of a mechanism, in numbered parts. The notes show
        whether the file belongs to this part of this sweep.

        Parameters
        ----------
        folder
            Folder of the parts.
        number
            Number of the part, whose file must exist.

        Returns
        -------
        The notes by key: ``"units"`` of the columns, `ROW_COUNTS_NOTE`, `PROCESSOR_NOTE`,
        and `SWEEP_NOTE` and `PART_NOTE`, which identify the part (see `part_notes`).

        Raises
        ------
        FileError
            If the file cannot be read, or is damaged.
        OutputError
            If the file belongs to another sweep, or to another part of this one.
        """
        path = self.path_of(folder, number)
        notes = read_notes(path)
        # The file must have all notes that identify the part, with the same values.
        if not self.part_notes(number).items() <= notes.items():
            raise OutputError(
                f"{path}: the file is not part {number} of this sweep; another program or "
                "another sweep has written it. Move the file away, and run the same "
                "command again to compute the part"
            )
        return notes

    def _worth_running(self, design: Floats, rows: DesignTable) -> bool:
        """Return whether the analyses of a design have to be run.

        A design that violates the conditions of the sweep is left out of the result. Some
        figures of merit (numbers that rate a design) are computed quickly, before the
        analyses. If they violate the conditions, the analyses need not be run.

        Parameters
        ----------
        design
            (variables,) values of the design variables, in the units of the file.
        rows
            One row for each assembly mode (way to assemble the mechanism) of the design,
            with the figures of merit that are computed before the analyses.

        Returns
        -------
        True if at least one row meets all conditions on variables and on these figures.
        """
        columns = self._variable_columns(design) | self._in_file_units(rows)
        return bool(np.any(self._meet_conditions(columns, len(rows.design))))

    def write_part(self, folder: str, number: int) -> int:
        """Compute a part of the designs, write its files, and return the part's number.

        A sweep evaluates many designs of a mechanism. The designs are divided into numbered
        parts, which different processes or computers can compute.

        Parameters
        ----------
        folder
            Path of the folder for the files. Missing folders are created.
        number
            Number of the part, counted from 0.

        Raises
        ------
        OutputError
            If a file cannot be written.
        """
        path = self.path_of(folder, number)
        make_folder(path.parent)
        # A sweep can run analyses for each design. This counter has the number of rows of
        # each of their result tables. `store_table` counts them.
        row_counts = Counter[str]()
        tables_folder = Path(folder) / TABLES_FOLDER
        # Notes in each file that say to which sweep and part it belongs.
        identification = self.part_notes(number)
        # `degrees` says whether the tables have angles in degrees.
        with open_part_tables(
            tables_folder, path.name, self.degrees, row_counts, identification
        ) as store_table:
            columns = self.compute_part(number, store_table)
        # The table of designs is written last: if it exists, the part is complete. Its
        # notes have the number of rows of each other table, and the kind of processor.
        notes = {
            "units": self.units(),
            ROW_COUNTS_NOTE: row_counts,
            PROCESSOR_NOTE: processor_identity(),
        }
        write_columns(path, columns, notes | identification)
        return number

    def move_part(self, work_folder: str, folder: Path, number: int) -> int:
        """Move the files of a part from the working folder to the folder of the sweep.

        A sweep evaluates many designs of a mechanism, in numbered parts. A part is first
        written to a working folder, so that the folder of the sweep has complete parts
        only.

        Parameters
        ----------
        work_folder
            Path of the working folder, in which the part was written.
        folder
            Folder of the sweep, to which the files are moved.
        number
            Number of the part.

        Returns
        -------
        Size of all files of the part together (bytes).

        Raises
        ------
        OutputError
            If a file of the part is not in the working folder, or cannot be moved.
        """
        paths = self.files_of(work_folder, number)
        if not paths:
            raise OutputError(
                f"{folder}: part {number} was computed, but is no longer in {work_folder}; "
                "another program or person has removed it. Run the same command again to "
                "compute it"
            )
        # `files_of` lists the table of designs first. This table is moved last, because its
        # presence shows that the part is complete.
        for path in reversed(paths):
            target = folder / path.relative_to(work_folder)
            make_folder(target.parent)
            try:
                path.replace(target)
            except OSError as error:
                raise output_error(target, "written", error) from None
        return sum(path.stat().st_size for path in self.files_of(folder, number))
