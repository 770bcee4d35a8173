"""A study from a TOML file of format 1: a mechanism and what is to be run on it."""

import os
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, final

from spherekit.conventions import listing, nearest
from spherekit.errors import AnalysisError, FileError, SpherekitError
from spherekit.files.angles import angle_at
from spherekit.files.check import check
from spherekit.files.document import Document, parse, read_text, spelt
from spherekit.files.library import STUDY_SUFFIX, find, is_study, shipped
from spherekit.files.locate import KeyPath
from spherekit.files.read import load
from spherekit.files.read_laws import read_laws, read_start
from spherekit.model.laws import Law, Start
from spherekit.model.mechanism import Input, Mechanism


@final
@dataclass(frozen=True)
class Study:
    """A mechanism with the input it is driven at, and what is to be run on it.

    `analyses` maps names to parameters as they stand in the file; whether such
    analyses exist and take them is for `spherekit.analysis.study` to say, with the
    lines of `document`. `folder` and `recording` are relative to the working folder.
    `laws` has the time law of each input that is given one, by pair, `duration` the time
    (s) from t = 0 on, and `start` the input's state at t = 0 for forward dynamics.
    """

    name: str
    mechanism: Mechanism
    samples: int | None = None
    branch: int | None = None
    search: bool = True
    analyses: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    folder: Path | None = None
    recording: Path | None = None
    degrees: bool = False
    laws: Mapping[str, Law] = field(default_factory=dict)
    duration: float | None = None
    start: Start | None = None
    document: Document | None = field(default=None, repr=False, compare=False)

    def fault(self, path: KeyPath, message: str) -> SpherekitError:
        """Return the error to raise about a key, with file and line if it has one."""
        if self.document is not None:
            return self.document.fault(path, message)
        return AnalysisError(f"{self.name}: {spelt(path)}: {message}")


def load_study(name_or_path: str | os.PathLike[str]) -> Study:
    """Read a study file; a mechanism file is read as the study with all defaults.

    Raises
    ------
    FileError
        If there is no such file, or with one line for each fault in it.
    """
    path = find(name_or_path)
    if not is_study(path):
        mechanism = load(path)
        return Study(mechanism.name, mechanism)
    document = parse(read_text(path), str(path))
    check(document, "study")
    data = document.data
    output = data.get("output", {})
    mechanism = _mechanism(document, path.parent)
    return Study(
        name=path.name.removesuffix(STUDY_SUFFIX),
        mechanism=_driven(document, mechanism),
        samples=int(data["samples"]) if "samples" in data else None,
        branch=int(data["branch"]) if "branch" in data else None,
        search=data.get("search", True),
        analyses=data.get("analyses", {}),
        folder=_path(document, output, "folder"),
        recording=_path(document, output, "recording"),
        degrees=output.get("degrees", False),
        laws=read_laws(document),
        duration=float(data["duration"]) if "duration" in data else None,
        start=read_start(document),
        document=document,
    )


def _mechanism(document: Document, folder: Path) -> Mechanism:
    wanted = document.data["mechanism"]
    is_shipped = any(wanted in pack.files for pack in shipped())
    try:
        path = find(wanted if is_shipped else folder / wanted)
    except FileError as error:
        raise document.fault(("mechanism",), str(error)) from None
    if is_study(path):
        raise document.fault(
            ("mechanism",), f'found "{wanted}", a study; needs a mechanism file'
        )
    return load(path)


def _driven(document: Document, mechanism: Mechanism) -> Mechanism:
    """Return the mechanism with the study's input first, over the study's range."""
    for pair, item in document.data.get("inputs", {}).items():
        path = ("inputs", pair)
        if pair not in mechanism.pair_number:
            hint = nearest(pair, mechanism.pair_number) or ";"
            raise document.fault(
                path,
                f'{mechanism.name} has no pair "{pair}"{hint} Pairs: '
                f"{listing(mechanism.pair_number)}",
            )
        own = mechanism.with_input(pair).inputs[0]
        start, stop = (
            angle_at(document, (*path, key), item[key], document.data["angle_unit"])
            if key in item
            else default
            for key, default in (("from", own.start), ("to", own.stop))
        )
        if not start < stop:
            raise document.fault(
                path,
                "the range must rise from `from` to `to`, but it is "
                f"{start:.6g} to {stop:.6g} rad",
            )
        others = (each for each in mechanism.inputs if each.pair != pair)
        return replace(mechanism, inputs=(Input(pair, start, stop), *others))
    return mechanism


def _path(document: Document, output: Mapping[str, str], key: str) -> Path | None:
    if key not in output:
        return None
    if not output[key].isprintable():
        raise document.fault(("output", key), f"{output[key]!a}: not a usable path")
    return Path(output[key])
