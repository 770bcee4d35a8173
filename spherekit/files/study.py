"""A study from a TOML file of format 1: a mechanism and what is to be run on it."""

import os
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, final

from spherekit.checked import checked
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
    """A mechanism with the inputs it is driven at, and what is to be run on it.

    `samples` are those of a path through the ranges of the inputs or, with a number for
    each input, of a grid; `path` has the inputs (rad) of every sample instead.
    `analyses` maps names to parameters as they stand in the file; whether such
    analyses exist and take them is for `spherekit.analysis.study` to say, with the
    lines of `document`. `folder` and `recording` are relative to the working folder.
    `laws` has the time law of each input that is given one, by pair, `duration` the time
    (s) from t = 0 on, and `start` the input's state at t = 0 for forward dynamics, with
    the `torque` (N m, an expression) that drives it and the `tolerance` of a step.
    `verify` is how many rows to compute once more in many digits.
    """

    name: str
    mechanism: Mechanism
    samples: int | tuple[int, ...] | None = None
    path: tuple[tuple[float, ...], ...] | None = None
    branch: int | None = None
    search: bool = True
    analyses: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    folder: Path | None = None
    recording: Path | None = None
    degrees: bool = False
    laws: Mapping[str, Law] = field(default_factory=dict)
    duration: float | None = None
    start: Start | None = None
    torque: str | None = None
    tolerance: float | None = None
    verify: int | None = None
    document: Document | None = field(default=None, repr=False, compare=False)

    def fault(self, path: KeyPath, message: str) -> SpherekitError:
        """Return the error to raise about a key, with file and line if it has one."""
        if self.document is not None:
            return self.document.fault(path, message)
        return AnalysisError(f"{self.name}: {spelt(path)}: {message}")


@checked(FileError)
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
    mechanism = _driven(document, _mechanism(document, path.parent))
    return Study(
        name=path.name.removesuffix(STUDY_SUFFIX),
        mechanism=mechanism,
        samples=_samples(document, mechanism),
        path=_input_path(document, mechanism),
        branch=int(data["branch"]) if "branch" in data else None,
        search=data.get("search", True),
        analyses=data.get("analyses", {}),
        folder=_path(document, output, "folder"),
        recording=_path(document, output, "recording"),
        degrees=output.get("degrees", False),
        laws=read_laws(document),
        duration=float(data["duration"]) if "duration" in data else None,
        start=read_start(document),
        torque=data.get("start", {}).get("torque"),
        tolerance=float(data["tolerance"]) if "tolerance" in data else None,
        verify=int(data["verify"]) if "verify" in data else None,
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
    """Return the mechanism with the study's inputs and their ranges."""
    given = document.data.get("inputs", {})
    for pair in given:
        if pair not in mechanism.pair_number:
            hint = nearest(pair, mechanism.pair_number) or "."
            raise document.fault(
                ("inputs", pair),
                f'{mechanism.name} has no pair "{pair}"{hint} Pairs: '
                f"{listing(mechanism.pair_number)}",
            )
    if not {item.pair for item in mechanism.inputs}.issuperset(given):
        mechanism = mechanism.with_inputs(*given)
    ranged = (
        _ranged(document, item) if item.pair in given else item for item in mechanism.inputs
    )
    return replace(mechanism, inputs=tuple(ranged))


def _ranged(document: Document, own: Input) -> Input:
    """Return an input over the range that the study gives it."""
    path, item = ("inputs", own.pair), document.data["inputs"][own.pair]
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
    return Input(own.pair, start, stop)


def _samples(document: Document, mechanism: Mechanism) -> int | tuple[int, ...] | None:
    found = document.data.get("samples")
    if not isinstance(found, list):
        return None if found is None else int(found)
    if len(found) != len(mechanism.inputs):
        raise document.fault(
            ("samples",),
            f"has {len(found)} numbers for {len(mechanism.inputs)} inputs "
            f"({listing(item.pair for item in mechanism.inputs)})",
        )
    return tuple(int(count) for count in found)


def _input_path(
    document: Document, mechanism: Mechanism
) -> tuple[tuple[float, ...], ...] | None:
    """Return the rows of the inputs' values, one number for each input, if given."""
    given = document.data.get("inputs", {})
    if not any("values" in item for item in given.values()):
        return None
    columns = []
    for item in mechanism.inputs:
        path = ("inputs", item.pair)
        table = given.get(item.pair, {})
        if "values" not in table:
            raise document.fault(
                path if item.pair in given else ("inputs",),
                f"input {item.pair} has no values, but another input has; give values "
                "for every input",
            )
        for key in ("from", "to"):
            if key in table:
                raise document.fault(
                    (*path, key), "excluded by values, which says every sample"
                )
        unit = document.data["angle_unit"]
        columns.append(
            tuple(
                angle_at(document, (*path, "values", k), number, unit)
                for k, number in enumerate(table["values"])
            )
        )
        if len(columns[-1]) != len(columns[0]):
            raise document.fault(
                (*path, "values"),
                f"has {len(columns[-1])} values, input {mechanism.inputs[0].pair} has "
                f"{len(columns[0])}; give equally many",
            )
    if "samples" in document.data:
        raise document.fault(("samples",), "excluded by the inputs' values")
    return tuple(zip(*columns, strict=True))


def _path(document: Document, output: Mapping[str, str], key: str) -> Path | None:
    if key not in output:
        return None
    if not output[key].isprintable():
        raise document.fault(("output", key), f"{output[key]!a}: not a usable path")
    return Path(output[key])
