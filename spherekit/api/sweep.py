"""Sweeps: figures of merit or tables of many designs, stated by names and texts."""

import os
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING

from spherekit.argument_validation import checked
from spherekit.conventions import AnyPath, Names
from spherekit.designs.design_runs import RUN_MODE_PREFIX
from spherekit.designs.design_space import DesignSpace, Scheme, parse_variation
from spherekit.designs.figures_of_merit import DesignSamples
from spherekit.designs.sweep import Sweep
from spherekit.designs.sweep_parts import SweepResult, run_sweep
from spherekit.designs.worker_processes import can_start_workers
from spherekit.errors import DesignError
from spherekit.files.library import find, is_study
from spherekit.files.mechanism_reader import load
from spherekit.files.number_change import document_of, is_angle
from spherekit.files.study import Crossings, Study
from spherekit.files.study_reader import Subject, study_of
from spherekit.files.toml_document import Document
from spherekit.mechanism.mechanism import Mechanism
from spherekit.planning.assembly_plan import driven_at
from spherekit.quantity import AngleUnit
from spherekit.resources import usable_cores
from spherekit.runs.figure_of_merit import FigureOfMerit, parse_merit
from spherekit.runs.registry import create_analysis
from spherekit.runs.run_result import Columns
from spherekit.runs.sampling import check_time, make_sampling

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from spherekit.runs.contract import AbstractAnalysis


Vary = Mapping[str, str | Sequence[float]]
"""Values of the numbers of a mechanism file that vary, by the keys of the numbers."""


@checked(DesignError)
def sweep(
    subject: Subject,
    vary: Vary,
    reduce: str | Sequence[str] = (),
    *,
    analyses: Sequence[str] = (),
    tables: bool = False,
    where: str | Sequence[str] = (),
    samples: int | Sequence[int] | None = None,
    crossings: Crossings | None = None,
    designs: int | None = None,
    scheme: Scheme | None = None,
    seed: int = 0,
    folder: AnyPath | None = None,
    workers: int | None = None,
    dask: str | None = None,
) -> SweepResult:
    """Return figures of merit, or whole tables, of many designs of one mechanism.

    A design is a choice of the sizes that vary. A figure of merit is one number for a
    design in one assembly mode (way to assemble the mechanism).

    Parameters
    ----------
    subject
        A mechanism or a study, or the path or the shipped name of either.
    vary
        The sizes that vary: for each key of the mechanism file, such as ``"links.2.arc"``,
        its values in the units of the file. The values are a sequence of numbers, or a
        text. The text ``"10:40:31"`` states 31 values from 10 to 40. The text ``"10:40"``
        states all values from 10 to 40, of which `designs` chooses some.
    reduce
        Figures of merit, such as ``"least=min(transmission_angle_43)"``. The name before
        ``=`` is that of the column in the result and may be left out. A reduction, such as
        ``min``, makes one number of the values at all configurations of a design. Its
        argument is an expression of quantities of a configuration (rad, SI).
    analyses
        Names of analyses whose own figures of merit are computed too.
    tables
        Whether the tables of these analyses are computed for every design, as in a run.
        `SweepResult.table` reads them.
    where
        Conditions, such as ``"links_2_arc < links_4_arc"`` or ``"least > 30"``. Designs and
        rows that do not meet them are left out.
    samples
        Number of samples at which each design is computed. The samples are on a straight
        path through the ranges of the inputs. A sequence of numbers, one for each input,
        states a grid. By default the study states the samples.
    crossings
        How an assembly mode continues where its curve of configurations crosses the curve
        of another mode. A dyad (two links with three R pairs) can be assembled in two ways,
        and its sign selects one of them. With ``"end"`` the mode keeps the signs of its
        dyads. With ``"pass"`` the mode follows the smooth curve, so these signs can change
        at a crossing. By default the study decides.
    designs, scheme, seed
        Number of designs, the method that chooses them (``"sobol"``, ``"latin"`` or
        ``"random"``), and the seed of its random numbers. By default the designs are all
        combinations of the values.
    folder
        Folder in which the parts of the sweep are written as Parquet files. If a sweep was
        stopped in this folder, it is continued.
    workers
        Number of processes, by default one for each core. Without a folder there is only
        one process.
    dask
        Address of a Dask scheduler whose workers compute the parts. Workers that do not see
        the folder send their parts (results of successive designs) through the scheduler.

    Returns
    -------
    SweepResult
        The result has a row for each design and assembly mode. A design that is impossible,
        or that cannot be assembled at any sample, has one row. The columns `status` and
        `reason` of this row say why.

    Raises
    ------
    DesignError, SolveError, FileError, AnalysisError
        If an argument is wrong. The error is raised before anything is computed.
    EngineError
        If the mechanism has pairs for which sweeps are not possible.
    OutputError
        If the folder contains another sweep or cannot be written, or if a part is missing
        at the end.

    Examples
    --------
    >>> import spherekit as sk
    >>> found = sk.sweep(
    ...     "four_bar",
    ...     {"links.2.arc": "10:30:3", "links.3.arc": [60, 70]},
    ...     "least=min(transmission_angle_43)",
    ... )
    >>> found.frame()[["links_2_arc", "grashof", "least"]].shape
    (12, 3)

    The column ``grashof`` has the Grashof class of a four-bar: which of its links turn
    fully.
    """
    study = study_of(subject)
    angle_unit = study.mechanism.angle_unit
    variations = [parse_variation(*item, angle_unit) for item in vary.items()]
    full_sweep = sweep_of(
        subject,
        DesignSpace.from_variations(variations, designs, scheme, seed),
        [reduce] if isinstance(reduce, str) else reduce,
        [create_analysis(name, angle_unit) for name in analyses],
        samples,
        tables=tables,
        crossings=crossings,
    )
    conditions = (where,) if isinstance(where, str) else tuple(where)
    return perform(replace(full_sweep, where=conditions), folder, workers, dask)


def sweep_of(
    subject: Subject,
    space: DesignSpace,
    reduce: Sequence[str],
    analyses: Sequence["AbstractAnalysis"] = (),
    samples: int | Sequence[int] | None = None,
    source: AnyPath | None = None,
    tables: bool = False,
    crossings: Crossings | None = None,
) -> Sweep:
    """Return a sweep (computation of many designs of a mechanism), ready to be computed.

    Parameters
    ----------
    subject
        A mechanism or a study, or the path or the shipped name of either.
    space
        The designs: the sizes that vary and their values.
    reduce
        Texts of figures of merit, such as ``"least=min(transmission_angle_43)"``. Each
        gives one number for a design.
    analyses
        Analyses whose own figures of merit, or tables, are computed.
    samples
        Number of samples of each design; by default the study's.
    source
        The file of `subject`, if it is known. Keys of sizes refer to it.
    tables
        Whether the tables of the analyses are computed for every design.
    crossings
        See `sweep`.

    Raises
    ------
    DesignError
        If an analysis is requested twice or contributes nothing, two texts give different
        figures one name, or tables are requested without an analysis.
    AnalysisError, FileError
        If a text is no figure of merit, or the times of the study do not fit together.
    """
    study = study_of(subject)
    study = replace(study, mechanism=driven_at(study.mechanism))
    if samples is not None:
        study = replace(study, samples=samples, path=None)
    if crossings is not None:
        study = replace(study, crossings=crossings)
    check_time(study)
    document = _document(study.mechanism, subject if source is None else source)
    angle_unit: AngleUnit = document.data["angle_unit"]
    for variation in space.variations:
        if variation.has_angle_unit and not is_angle(document, variation.key):
            raise DesignError(
                f"{variation.key}: this number of the mechanism is not an angle, but its "
                "values are given in a unit of angles; leave the unit out"
            )

    for name, count in Counter(analysis.name for analysis in analyses).items():
        if count > 1:
            raise DesignError(
                f"{name}: the analysis is requested {count} times in one sweep; request it "
                "once, with values joined by + (poles:only=31+42), or use two sweeps"
            )

    # Figures of the user replace those of analyses, and later ones of analyses replace
    # earlier ones, of the same name.
    merits: dict[str, FigureOfMerit] = {}
    user_merits = [parse_merit(text, angle_unit) for text in reduce]
    read_analyses = {merit.of_table[0] for merit in user_merits if merit.table}
    for analysis in analyses:
        analysis_merits = analysis.merits(study.mechanism)
        if not (analysis_merits or tables or analysis.name in read_analyses):
            raise DesignError(
                f"{analysis.name} defines no figures of merit for "
                f"{study.mechanism.name}; compute figures from its tables with the "
                "argument reduce, or keep its tables with tables=True"
            )
        for merit in analysis_merits:
            merits[merit.name] = merit
    text_of_name: dict[str, str] = {}
    for text, merit in zip(reduce, user_merits, strict=True):
        first_text = text_of_name.setdefault(merit.name, text)
        if first_text != text and merits[merit.name] != merit:
            raise DesignError(
                f'{study.mechanism.name}: "{first_text}" and "{text}" would both be called '
                f'"{merit.name}"; give one of them another name: '
                "NAME=REDUCTION(EXPRESSION)"
            )
        merits[merit.name] = merit
    if tables and not analyses:
        raise DesignError(
            f"{study.mechanism.name}: tables are requested, but no analysis is; give the "
            "analyses whose tables are to be written"
        )

    # Figures of merit that are read from the tables of an analysis need a run of each
    # design. All others are computed from samples directly, which is faster.
    table_merits = [merit for merit in merits.values() if merit.table]
    needs_samples = len(table_merits) < len(merits) or not (merits or tables)
    analysis_of_name = {analysis.name: analysis for analysis in analyses}
    run_names = list(analysis_of_name) if tables else []
    run_names += [merit.of_table[0] for merit in table_merits]
    run_names = list(dict.fromkeys(run_names))
    return Sweep(
        study.mechanism,
        DesignSamples.from_study(study) if needs_samples else None,
        document,
        space,
        tuple(merits.values()),
        study=study if run_names else None,
        analyses=tuple(
            analysis_of_name.get(name) or create_analysis(name, study.mechanism.angle_unit)
            for name in run_names
        ),
        tables=tables,
        mode_labels=_labels_of_mode(study),
    )


def _labels_of_mode(study: Study) -> Names:
    """Return the labels by which a sweep may call the assembly mode of a study.

    A sweep analyses many designs (choices of sizes). The labels serve to select the rows of
    one assembly mode (way to assemble the mechanism). The same mode may have different
    labels in the rows of different designs. Mode 1 with the signs ``+-`` has four labels:

    - ``+-``, a sign for each dyad (group of two links);
    - ``1 +-``, number and signs;
    - ``1``, the number alone;
    - ``run 1``, the number after the word "run". Usually a fast computation of many designs
      finds the modes. This label is for a mode that only a run of its single design found.

    If the study states no mode, all modes are computed and there are no labels.

    Raises
    ------
    SolveError
        If the mechanism has no such mode.
    """
    if study.assembly_mode is None:
        return ()
    # A sweep numbers modes over the ranges of the inputs. With a law of time for the
    # inputs, or a simulation from a start, the analysis would cover other inputs, and modes
    # could have other numbers. So laws, start and torque are removed from the study.
    at_rest = replace(study, start=None, torque=None, laws={}, duration=None)
    # The position analysis of a study that states a mode has only this mode.
    (mode,) = make_sampling(at_rest).position_analysis.assembly_modes
    number = str(mode.number)
    return mode.label, f"{number} {mode.label}", number, f"{RUN_MODE_PREFIX} {number}"


def perform(
    sweep: Sweep,
    folder: AnyPath | None,
    workers: int | None,
    dask: str | None,
) -> SweepResult:
    """Compute a sweep: analyse many designs (choices of sizes) of one mechanism.

    The designs are computed in this process, in worker processes or on a Dask cluster.

    Parameters
    ----------
    sweep
        The designs and what to compute for each of them.
    folder
        Folder for the parts, which are files with the results of some of the designs.
        Without a folder only this process computes.
    workers
        Number of processes; by default one for each core.
    dask
        Address of the scheduler of a Dask cluster. None: compute on this machine.

    Raises
    ------
    DesignError
        If the number of processes is below 1, or a cluster has no folder.
    """
    if workers is not None and workers < 1:
        raise DesignError(f"workers: found {workers}, expected at least 1 process")
    if dask is None:
        is_alone = folder is None or not can_start_workers()
        process_count = 1 if is_alone else workers or usable_cores()
        return run_sweep(sweep, folder, process_count, draw=_draw_figures)
    if folder is None:
        raise DesignError(
            "dask: a sweep on a cluster writes its parts into a folder; give the "
            "argument folder"
        )
    from spherekit.designs.dask_cluster import check_cluster, compute_on_cluster

    check_cluster()
    return run_sweep(
        sweep, folder, elsewhere=partial(compute_on_cluster, dask), draw=_draw_figures
    )


def _draw_figures(result: SweepResult, columns: Columns) -> "dict[str, Figure]":
    """Return the figures of a sweep; matplotlib is imported only now."""
    from spherekit.display.figures.sweep_plots import sweep_figures

    return sweep_figures(result, columns)


def _document(mechanism: Mechanism, subject: Subject) -> Document:
    """Return the parsed TOML file of a mechanism, in which a sweep changes numbers.

    The file of the mechanism is used if it has the same sizes, masses and loads as the
    mechanism. Only the inputs (driven pairs and their ranges) may differ. Otherwise a new
    document is written from the mechanism, for example if a study changed the mechanism.

    Parameters
    ----------
    mechanism
        The mechanism.
    subject
        The file or object from which the mechanism was made. If it is an object or a study
        file (a file that says what to compute for a mechanism), the document is made from
        the mechanism.
    """
    if isinstance(subject, str | os.PathLike) and not is_study(find(subject)):
        mechanism_of_file = load(subject)
        if replace(mechanism_of_file, inputs=()) == replace(mechanism, inputs=()):
            return document_of(subject)
    # The new document has its angles in the unit that the user chose for the file.
    return document_of(mechanism, mechanism.angle_unit)
