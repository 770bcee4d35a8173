"""Trades stored in files: for which run they were made, and reading them."""

import json
from dataclasses import fields
from pathlib import Path

import numpy as np

from spherekit.conventions import AnyPath, Facts
from spherekit.errors import AnalysisError
from spherekit.files.mechanism_writer import mechanism_hash
from spherekit.files.study import Study
from spherekit.planning.assembly_plan import driven_at
from spherekit.runs.contract import AbstractAnalysis
from spherekit.runs.evaluation_options import Setting
from spherekit.runs.run_state import describe_analyses, hash_array
from spherekit.runs.trade_record import ATTRIBUTE_BY_KEY, COLUMN_KEYS, Measured, Trade
from spherekit.version import __version__

TRADE_FILE = "trade.json"
"""Name of the file with a trade in a folder."""

NUMBER_FIELDS = tuple(item.name for item in fields(Measured) if item.type is float)
"""Attributes of `Measured` that are times and errors."""


def describe_run(study: Study, analysis: AbstractAnalysis) -> Facts:
    """Return the facts about a run on which the measured times and errors depend.

    A trade is a set of measurements: the time and the error of each setting of a run. The
    facts are stored with it, so that it is not used for another run. All values can be
    written as JSON.

    Parameters
    ----------
    study
        The study of the run.
    analysis
        The analysis for which the settings are measured.
    """
    # Without names of inputs, this only checks the inputs of the mechanism.
    mechanism = driven_at(study.mechanism)
    # The values of the inputs at all samples, if the study lists them.
    path = study.path
    # The description of an analysis is its name, version and parameters.
    ((_, version, analysis_parameters),) = describe_analyses([analysis])
    # A simulation (a study with a start) has a single assembly mode, by default the first.
    assembly_mode = study.assembly_mode
    if study.start is not None:
        assembly_mode = study.assembly_mode or 0
    return {
        "spherekit": __version__,
        "mechanism": mechanism.name,
        "mechanism_hash": mechanism_hash(mechanism),
        "analysis": analysis.name,
        "analysis_version": version,
        "parameters": analysis_parameters,
        "inputs": mechanism.input_pairs,
        "samples": "x".join(map(str, study.shape)),
        "input_values": None if path is None else hash_array(path),
        "assembly_mode": assembly_mode,
        # Whether all assembly modes (ways to assemble the mechanism) are searched.
        "search": study.search,
        # Which curve a mode follows where configuration curves cross: "pass" continues
        # smoothly. The default "end" has no key, as trades of earlier versions lack it.
        **({"crossings": "pass"} if study.crossings == "pass" else {}),
        # Inputs that are given as functions of time.
        "laws": {pair: repr(law) for pair, law in study.laws.items()},
        "duration": study.duration,
        # Inputs and their rates at the start of a simulation, and its driving torque.
        "start": None if study.start is None else [study.start.q, study.start.dq],
        "torque": study.torque,
    }


def folder_of_trade(path: AnyPath) -> Path:
    """Return the folder to which a trade is written, from its path or that of its file."""
    return Path(path).parent if Path(path).is_file() else Path(path)


def read_trade(path: AnyPath) -> Trade:
    """Read the trade that the command `spherekit trade -o` has written.

    A trade consists of the settings of a run (ways to compute it) with their measured times
    and errors.

    Parameters
    ----------
    path
        The folder, or the file in it.

    Raises
    ------
    AnalysisError
        If there is no trade, or if it cannot be read.
    """
    file = Path(path)
    advice = f"write one with: spherekit trade FILE -a NAME -o {folder_of_trade(path)}"
    try:
        if file.is_dir():
            file = file / TRADE_FILE
        if file.exists() and not file.is_file():
            raise AnalysisError(
                f"{file}: is not a regular file; give the folder or the file that was "
                "written by: spherekit trade FILE -a NAME -o DIR"
            )
        text = file.read_bytes()
    except FileNotFoundError:
        raise AnalysisError(f"{file}: contains no trade; {advice}") from None
    except (OSError, ValueError) as problem:
        raise AnalysisError(f"{file}: cannot be read ({problem}); {advice}") from None
    try:
        return _make_trade(json.loads(text))
    except (AnalysisError, KeyError, TypeError, ValueError, RecursionError) as problem:
        missing = isinstance(problem, KeyError)
        reason = f"the key {problem} is missing" if missing else str(problem)
        raise AnalysisError(
            f"{file}: this is not a trade that this version can read ({reason}); {advice}"
        ) from None


def _make_trade(data: Facts) -> Trade:
    """Return a trade from the data of `Trade.as_dict`."""
    if not isinstance(data["made_for"], dict):
        raise TypeError("made_for is not an object")
    return Trade(
        columns=tuple(
            tuple(column[key] for key in COLUMN_KEYS) for column in data["columns"]
        ),
        settings=tuple(map(_make_measured, data["settings"])),
        **{name: data[key] for key, name in ATTRIBUTE_BY_KEY.items()},
    )


def _make_measured(row: Facts) -> Measured:
    """Return the times and errors of a setting from data in which NaN is None."""
    values: Facts = {
        item.name: np.nan if row[item.name] is None else row[item.name]
        for item in fields(Measured)
    }
    for name in NUMBER_FIELDS:
        values[name] = float(values[name])
    values["setting"] = None if row["setting"] is None else Setting(**row["setting"])
    return Measured(**values)
