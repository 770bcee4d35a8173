"""Running studies: the analyses a study file names, checked against their plugins."""

import os
import types
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import MISSING, replace
from typing import Any, Literal, Union, get_args, get_origin, get_type_hints

import numpy as np

from spherekit.analysis.arguments import parameters
from spherekit.analysis.contract import AbstractAnalysis
from spherekit.analysis.course import DEFAULT_TOLERANCE
from spherekit.analysis.journal import Unfinished
from spherekit.analysis.recording import Recorder
from spherekit.analysis.registry import load
from spherekit.analysis.result import RunResult
from spherekit.analysis.run import Progress, run
from spherekit.analysis.setting import ORDINARY, Setting
from spherekit.analysis.tables import FILE_SIZE, Format
from spherekit.checked import checked
from spherekit.conventions import listing, nearest
from spherekit.engine.kernels import Engine
from spherekit.errors import AnalysisError, ModelError, PluginError, SpherekitError
from spherekit.files.check import mismatch, shown
from spherekit.files.study import Study, load_study
from spherekit.model.dynamics import DRIVE, PairTorque
from spherekit.model.laws import time_fault
from spherekit.motion.motion import DEFAULT_SAMPLES
from spherekit.planning.inputs import driven_pairs

DEFAULT_ANALYSIS = "poles"
_WORDS = {
    bool: "true or false",
    int: "a whole number",
    float: "a number",
    str: "text in quotes",
}


@checked(AnalysisError)
def run_study(
    study: Study | str | os.PathLike[str],
    analyses: Sequence[str | AbstractAnalysis] = (),
    *,
    folder: str | os.PathLike[str] | None = None,
    unfinished: Unfinished = "refuse",
    formats: Sequence[Format] = tuple(FILE_SIZE),
    engine: Engine = "auto",
    only_needed: bool = False,
    tables: bool = True,
    recorder: Recorder | None = None,
    log_every: int | None = None,
    progress: Progress | None = None,
    setting: Setting = ORDINARY,
    accuracy: Mapping[str, Any] | None = None,
) -> RunResult:
    """Run a study, given as such, as the path of its file, or as a shipped name.

    Nothing is written unless a `folder` is given, such as the study's own.

    Parameters
    ----------
    study
        The study; a mechanism file is the study with all defaults.
    analyses
        Names or analysis objects that replace the study's own.
    folder, unfinished, formats, engine, only_needed, tables, recorder, log_every, progress,
    setting, accuracy
        See `spherekit.run`.

    Raises
    ------
    FileError
        With file and line of what the study asks for wrongly.
    PlanError, SolveError
        See `spherekit.run`.
    """
    if not isinstance(study, Study):
        study = load_study(study)
    check_time(study)
    return run(
        study.mechanism,
        analyses or analyses_of(study),
        samples=study.samples or DEFAULT_SAMPLES,
        path=None if study.path is None else np.array(study.path),
        branch=study.branch,
        search=study.search,
        laws=study.laws,
        duration=study.duration,
        start=study.start,
        torque=study.torque,
        tolerance=study.tolerance or DEFAULT_TOLERANCE,
        engine=engine,
        only_needed=only_needed,
        folder=folder,
        unfinished=unfinished,
        degrees=study.degrees,
        formats=formats,
        tables=tables,
        recorder=recorder,
        log_every=log_every,
        progress=progress,
        setting=setting,
        accuracy=accuracy,
        verify=study.verify,
    )


def check_time(study: Study) -> None:
    """Refuse a study in which laws, duration, start and samples do not fit together.

    Raises
    ------
    FileError
        With file and line of what does not fit.
    """
    pairs = study.mechanism.pairs
    inputs = [pairs[pair].name for pair in driven_pairs(study.mechanism)]
    fault = time_fault(inputs, study.laws, study.duration, study.start, study.torque)
    if fault is not None:
        raise study.fault(*fault)
    if study.torque is not None:
        drive = PairTorque(DRIVE, inputs[0], study.torque)
        try:
            replace(study.mechanism, loads=(*study.mechanism.loads, drive))
        except ModelError as problem:
            raise study.fault(("start", "torque"), str(problem)) from None
    if study.duration is None:
        return
    if study.path is not None:
        raise study.fault(
            ("inputs", inputs[0], "values"),
            "excluded by the duration: over time the samples are times",
        )
    if isinstance(study.samples, tuple):
        raise study.fault(
            ("samples",),
            "over time the samples are times; give a single number of them",
        )


def analyses_of(study: Study) -> list[AbstractAnalysis]:
    """Return the analyses that a study names, poles by default.

    Raises
    ------
    FileError
        If there is no such analysis or parameter, a value has the wrong type, a
        parameter is missing, or the analysis refuses the mechanism.
    PluginError
        If an analysis that is asked for cannot be used.
    """
    found = []
    for name, values in (study.analyses or {DEFAULT_ANALYSIS: {}}).items():
        with _located(study, name):
            cls = load(name)
        given = _given(study, cls, values)
        with _located(study, name):
            analysis = cls(**given)
            analysis.needs(study.mechanism)
        found.append(analysis)
    return found


@contextmanager
def _located(study: Study, name: str) -> Iterator[None]:
    """Give complaints about an analysis the file and line that ask for it."""
    try:
        yield
    except PluginError:
        raise
    except SpherekitError as problem:
        raise study.fault(("analyses", name), str(problem)) from None


def _given(
    study: Study, cls: type[AbstractAnalysis], values: Mapping[str, Any]
) -> dict[str, Any]:
    path = ("analyses", cls.name)
    allowed, hints = parameters(cls), get_type_hints(cls)
    given = {}
    for key, value in values.items():
        if key not in allowed:
            known = listing(f"{each} ({kind})" for each, (kind, _) in allowed.items())
            raise study.fault(
                (*path, key),
                f"unknown parameter{nearest(key, allowed) or ';'} allowed for "
                f"{cls.name}: {known or 'none'}",
            )
        try:
            given[key] = _typed(value, hints[key])
        except TypeError:
            wanted = mismatch(value, _words(hints[key]))
            raise study.fault((*path, key), wanted) from None
    missing = [
        key
        for key, (_, default) in allowed.items()
        if default is MISSING and key not in given
    ]
    if missing:
        raise study.fault(path, f"parameters missing: {listing(missing)}")
    return given


def _typed(value: Any, hint: Any) -> Any:
    """Return a value of a file as a parameter of this type, or raise `TypeError`."""
    origin, inner = get_origin(hint), get_args(hint)
    if hint is float and isinstance(value, int | float) and not isinstance(value, bool):
        return float(value)
    if hint in (bool, int, str) and type(value) is hint:
        return value
    if origin is Literal and value in inner:
        return value
    if origin is tuple and isinstance(value, list):
        if inner[1:] == (...,):
            return tuple(_typed(item, inner[0]) for item in value)
        if len(inner) == len(value):
            pairs = zip(value, inner, strict=True)
            return tuple(_typed(item, each) for item, each in pairs)
    if origin in (Union, types.UnionType):
        for each in inner:
            with suppress(TypeError):
                return _typed(value, each)
    raise TypeError(hint)


def _words(hint: Any) -> str:
    """Return what a file has to hold for a parameter of this type."""
    origin, inner = get_origin(hint), get_args(hint)
    if origin is Literal:
        return f"one of {listing(map(shown, inner))}"
    if origin is tuple:
        if inner[1:] == (...,):
            return f"an array [...] with in each place {_words(inner[0])}"
        return f"an array of {len(inner)} values: {listing(map(_words, inner))}"
    if origin in (Union, types.UnionType):
        return " or ".join(_words(each) for each in inner if each is not types.NoneType)
    return _WORDS.get(hint, f"a value of type {hint}, which no file can give")
