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
from spherekit.runs.trade_record import COLUMN, STORED, Measured, Trade
from spherekit.version import __version__

FILE = "trade.json"


def run_of(study: Study, analysis: AbstractAnalysis) -> Facts:
    """Return what a trade for a study's run depends on, ready for JSON."""
    mechanism = driven_at(study.mechanism)
    path = study.path
    ((_, version, given),) = describe_analyses([analysis])
    return {
        "spherekit": __version__,
        "mechanism": mechanism.name,
        "mechanism_hash": mechanism_hash(mechanism),
        "analysis": analysis.name,
        "analysis_version": version,
        "parameters": given,
        "inputs": mechanism.input_pairs,
        "samples": "x".join(map(str, study.shape)),
        "input_values": None if path is None else hash_array(path),
        "assembly_mode": study.assembly_mode
        if study.start is None
        else study.assembly_mode or 0,
        "search": study.search,
        # Trades of earlier versions have no such key.
        **({"crossings": "pass"} if study.crossings == "pass" else {}),
        "laws": {pair: repr(law) for pair, law in study.laws.items()},
        "duration": study.duration,
        "start": None if study.start is None else [study.start.q, study.start.dq],
        "torque": study.torque,
    }


def read_trade(path: AnyPath) -> Trade:
    """Return the trade that `spherekit trade -o` wrote into a folder.

    Raises
    ------
    AnalysisError
        If there is none, or it cannot be read.
    """
    file = Path(path)
    again = f"write one with: spherekit trade FILE -a NAME -o {path}"
    try:
        if file.is_dir():
            file = file / FILE
        if file.exists() and not file.is_file():
            raise ValueError("a folder or a device, not a regular file")
        return _trade(json.loads(file.read_bytes()))
    except FileNotFoundError:
        raise AnalysisError(f"{file}: there is no trade; {again}") from None
    except (OSError, KeyError, TypeError, ValueError) as problem:
        raise AnalysisError(
            f"{file}: is not a trade that this version reads ({problem!r}); {again}"
        ) from None


def _trade(data: Facts) -> Trade:
    return Trade(
        columns=tuple(tuple(column[key] for key in COLUMN) for column in data["columns"]),
        settings=tuple(map(_measured, data["settings"])),
        **{name: data[key] for key, name in STORED.items()},
    )


def _measured(row: Facts) -> Measured:
    given: Facts = {
        x.name: np.nan if row[x.name] is None else row[x.name] for x in fields(Measured)
    }
    given["setting"] = None if row["setting"] is None else Setting(**row["setting"])
    return Measured(**given)
