"""Sweeps from names, paths and texts."""

import os
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
from spherekit.files.mechanism_reader import angle_unit_of, load
from spherekit.files.number_change import document_of
from spherekit.files.study import Crossings, Study
from spherekit.files.study_reader import Subject, study_of
from spherekit.files.toml_document import Document
from spherekit.mechanism.mechanism import Mechanism
from spherekit.mechanism.sizes import to_radians
from spherekit.planning.assembly_plan import driven_at
from spherekit.resources import usable_cores
from spherekit.runs.figure_of_merit import FigureOfMerit, parse_merit
from spherekit.runs.registry import create
from spherekit.runs.sampling import make_sampling

if TYPE_CHECKING:
    from spherekit.runs.contract import AbstractAnalysis


Vary = Mapping[str, str | Sequence[float]]


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
    """Return figures of merit, or whole tables, of many designs of one topology.

    Parameters
    ----------
    subject
        A mechanism or a study, or the path or the shipped name of either.
    vary
        By key of the file, such as ``"links.2.arc"`` or ``"pairs.41.zero"``, in the
        file's units: a sequence of values, ``"10:40:31"`` for so many from 10 to 40, or
        ``"10:40"`` for all between with `designs`.
    reduce
        Figures of merit, ``"least=min(transmission_angle_43)"``: a name if wanted, a
        reduction, an expression of what a configuration has (rad, SI).
    analyses
        Names of analyses whose own figures of merit are wanted too.
    tables
        Whether the tables that runs of these analyses have are wanted, of every design;
        `SweepResult.table` reads them.
    where
        Conditions, ``"links_2_arc < links_4_arc"`` or ``"least > 30"``: designs and rows
        that do not meet them are left out.
    samples
        Samples of the inputs that each design goes through, on the straight way through
        their ranges, or a number for each input of a grid; by default the study's.
    crossings
        Whether modes keep the signs of their dyads where curves cross (``"end"``), or
        follow the smooth curves (``"pass"``); by default the study's.
    designs, scheme, seed
        How many designs, by ``"sobol"``, ``"latin"`` or ``"random"``; without them the
        grid of all combinations.
    folder
        Where parts are written, Parquet; a sweep that was stopped there goes on.
    workers
        Processes at work, by default one for each core; without a folder there is one.
    dask
        Address of a Dask scheduler whose workers compute the parts. Those that do not see
        the folder send their parts through the scheduler.

    Returns
    -------
    SweepResult
        A row for each design and assembly mode; designs that are impossible or never close
        have one with the reason in `status`.

    Raises
    ------
    DesignError, SolveError, FileError, AnalysisError
        With what is asked for wrongly, before anything is computed.
    EngineError
        If the mechanism has pairs that no kernel knows.
    OutputError
        If the folder holds another sweep, or cannot be written, or a part is missing in
        the end.

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
    """
    made = sweep_of(
        subject,
        DesignSpace.from_variations(
            [parse_variation(*item) for item in vary.items()], designs, scheme, seed
        ),
        [reduce] if isinstance(reduce, str) else reduce,
        [create(name) for name in analyses],
        samples,
        tables=tables,
        crossings=crossings,
    )
    conditions = (where,) if isinstance(where, str) else tuple(where)
    return perform(replace(made, where=conditions), folder, workers, dask)


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
    """Return the sweep that texts ask for; `source` is the file of a study, if known."""
    study = study_of(subject)
    study = replace(study, mechanism=driven_at(study.mechanism))
    if samples is not None:
        study = replace(study, samples=samples, path=None)
    if crossings is not None:
        study = replace(study, crossings=crossings)
    document = _document(study.mechanism, subject if source is None else source)
    unit = to_radians(1.0, document.data["angle_unit"])
    merits: dict[str, FigureOfMerit] = {}
    for analysis in analyses:
        offered = analysis.merits(study.mechanism)
        if not offered and not tables:
            raise DesignError(
                f"{analysis.name} has no figures of merit of its own for "
                f"{study.mechanism.name}; say what is wanted by reduce, or ask for tables"
            )
        merits |= {merit.name: merit for merit in offered}
    merits |= {m.name: m for m in (parse_merit(text, unit) for text in reduce)}
    if tables and not analyses:
        raise DesignError(
            f"{study.mechanism.name}: tables are those of analyses: say of which"
        )
    chosen = tuple(merits.values())
    without = (chosen or tables) and all(merit.table for merit in chosen)
    through = None if without else DesignSamples.from_study(study)
    given = {analysis.name: analysis for analysis in analyses}
    wanted = dict.fromkeys(given if tables else ())
    wanted |= dict.fromkeys(merit.of_table[0] for merit in chosen if merit.table)
    return Sweep(
        study.mechanism,
        through,
        document,
        space,
        chosen,
        study=study if wanted else None,
        analyses=tuple(given.get(name) or create(name) for name in wanted),
        tables=tables,
        mode_labels=_labels_of_mode(study),
    )


def _labels_of_mode(study: Study) -> Names:
    """Return what rows of a sweep may call the only assembly mode of a study, if any.

    Modes of dyads have their signs, modes that are followed also their number. Runs give
    numbers to modes that a kernel does not have.

    Raises
    ------
    SolveError
        If the mechanism has no such mode.
    """
    if study.assembly_mode is None:
        return ()
    # Modes have the numbers that they have along the ranges of the inputs.
    at_rest = replace(study, start=None, laws={}, duration=None)
    (mode,) = make_sampling(at_rest).position_analysis.assembly_modes
    number = str(mode.number)
    return mode.label, f"{number} {mode.label}", number, f"{RUN_MODE_PREFIX} {number}"


def perform(
    sweep: Sweep,
    folder: AnyPath | None,
    workers: int | None,
    dask: str | None,
) -> SweepResult:
    """Return what a sweep finds, by so many processes or by the workers of a cluster."""
    if workers is not None and workers < 1:
        raise DesignError(f"workers: {workers} processes; give at least 1")
    if dask is None:
        is_alone = folder is None or not can_start_workers()
        return run_sweep(sweep, folder, 1 if is_alone else workers or usable_cores())
    if folder is None:
        raise DesignError("dask: give the folder to which the parts go")
    from spherekit.designs.dask_cluster import check_cluster, compute_on_cluster

    check_cluster()
    return run_sweep(sweep, folder, elsewhere=partial(compute_on_cluster, dask))


def _document(mechanism: Mechanism, subject: Subject) -> Document:
    """Return the file that a mechanism is of, or else the file that it would make.

    A mechanism with locked pairs, or that of a study, is not that of a file.
    """
    if isinstance(subject, str | os.PathLike) and not is_study(find(subject)):
        if replace(load(subject), inputs=()) == replace(mechanism, inputs=()):
            return document_of(subject)
        return document_of(mechanism, angle_unit_of(subject))
    return document_of(mechanism)
