"""Trades kept on disk: what run they were made for, and reading them back."""

import hashlib
import json
import os
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from spherekit.analysis.contract import AbstractAnalysis
from spherekit.analysis.folder.journal import differences
from spherekit.analysis.running.setting import Setting
from spherekit.errors import AnalysisError
from spherekit.files.plain import as_json
from spherekit.files.write import mechanism_hash
from spherekit.model.study import Study
from spherekit.planning.inputs import driven_at
from spherekit.tradeoff.record import Measured, Trade
from spherekit.version import __version__

FILE = "trade.json"


def run_of(study: Study, analysis: AbstractAnalysis) -> dict[str, Any]:
    """Return what a trade for a study's run depends on, ready for JSON."""
    mechanism, path = driven_at(study.mechanism), study.path
    values = None
    if path is not None:
        values = hashlib.sha256(np.ascontiguousarray(path).tobytes()).hexdigest()
    given = asdict(analysis)  # type: ignore[call-overload]
    return {
        "spherekit": __version__,
        "mechanism": mechanism.name,
        "mechanism_hash": mechanism_hash(mechanism),
        "analysis": analysis.name,
        "analysis_version": analysis.version,
        "parameters": {key: as_json(value) for key, value in given.items()},
        "inputs": [item.pair for item in mechanism.inputs],
        "samples": "x".join(map(str, study.shape)),
        "input_values": values,
        "assembly_mode": study.assembly_mode
        if study.start is None
        else study.assembly_mode or 0,
        "search": study.search,
        "laws": {pair: repr(law) for pair, law in study.laws.items()},
        "duration": study.duration,
        "start": None if study.start is None else [study.start.q, study.start.dq],
        "torque": study.torque,
    }


def read_trade(path: str | os.PathLike[str]) -> Trade:
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
        data = json.loads(file.read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise AnalysisError(f"{file}: there is no trade; {again}") from None
    except (OSError, ValueError) as problem:
        raise AnalysisError(f"{file}: is not a trade ({problem}); {again}") from None
    try:
        return _trade(data)
    except (KeyError, TypeError, ValueError) as problem:
        raise AnalysisError(
            f"{file}: is not a trade that this version reads ({problem!r}); {again}"
        ) from None


def check_run(stored: Trade, now: Mapping[str, Any], where: str) -> None:
    """Raise `AnalysisError` unless a trade was made for a run, see `run_of`."""
    differs = differences(stored.made_for, now)
    if differs:
        raise AnalysisError(
            f"{where}: the trade was made for another run ({differs}); make it for this "
            f"one with: spherekit trade {now['mechanism']} -a {now['analysis']} -o {where} "
            "and the options of the run, or leave --trade out"
        )


def _trade(data: Mapping[str, Any]) -> Trade:
    rows = data["settings"]
    return Trade(
        mechanism=data["mechanism"],
        analysis=data["analysis"],
        samples=data["samples"],
        checked=data["checked_samples"],
        rows=data["checked_rows"],
        reference=data["reference"],
        floor=data["reference_error"],
        derivatives=data["derivatives"],
        columns=tuple(
            (column["column"], column["measured"], column["scale"])
            for column in data["columns"]
        ),
        settings=tuple(_measured(row, data["samples"]) for row in rows),
        made_for=dict(data["made_for"]),
    )


def _measured(row: Mapping[str, Any], samples: int) -> Measured:
    first = _number(row["first_seconds"])
    return Measured(
        name=row["name"],
        setting=None if row["setting"] is None else Setting(**row["setting"]),
        first=first,
        per_sample=1e-6 * _number(row["microseconds_per_sample"]),
        per_sample_median=(_number(row["seconds_median"]) - first) / samples,
        compile=row["compile_seconds"],
        error=_number(row["error"]),
        column=row["worst_column"],
        estimate=_number(row["own_estimate"]),
        missing=row["missing"],
        reason=row["reason"],
    )


def _number(value: float | None) -> float:
    return float("nan") if value is None else float(value)
