"""A study from a TOML file of format 1: a mechanism and what is to be run on it."""

import os
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np

from spherekit.checked import checked
from spherekit.conventions import DEFAULT_SAMPLES, listing, nearest
from spherekit.errors import FileError, ModelError
from spherekit.files.angles import angle_at
from spherekit.files.check import check
from spherekit.files.document import Document, parse, read_text
from spherekit.files.library import STUDY_SUFFIX, find, is_study, shipped
from spherekit.files.read import angle_unit_of, load
from spherekit.files.read_laws import read_laws, read_start
from spherekit.model.changes import AngleUnit
from spherekit.model.locking import lock
from spherekit.model.mechanism import Mechanism
from spherekit.model.parts import Input
from spherekit.model.study import DEFAULT_TOLERANCE, Study
from spherekit.sphere.rotation import Floats


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
    mechanism = _locked(document, _mechanism(document, path.parent))
    mechanism = _driven(document, mechanism)
    return Study(
        name=path.name.removesuffix(STUDY_SUFFIX),
        mechanism=mechanism,
        samples=_samples(document, mechanism),
        path=_input_path(document, mechanism),
        assembly_mode=data.get("assembly_mode"),
        search=data.get("search", True),
        analyses=data.get("analyses", {}),
        folder=_path(document, output, "folder"),
        recording=_path(document, output, "recording"),
        degrees=output.get("degrees", False),
        laws=read_laws(document),
        duration=float(data["duration"]) if "duration" in data else None,
        start=read_start(document),
        torque=data.get("start", {}).get("torque"),
        tolerance=float(data.get("tolerance", DEFAULT_TOLERANCE)),
        crossings=data.get("crossings", "end"),
        verify=int(data["verify"]) if "verify" in data else None,
        locate=document.fault,
    )


def angle_unit_of_mechanism(name_or_path: str | os.PathLike[str]) -> AngleUnit:
    """Return the unit of the angles in a mechanism file, or in that of a study."""
    path = find(name_or_path)
    if is_study(path):
        document = parse(read_text(path), str(path))
        path = find(_where(document, path.parent))
    return angle_unit_of(path)


def _locked(document: Document, mechanism: Mechanism) -> Mechanism:
    """Return the mechanism with the pairs locked that a study locks."""
    data = document.data
    if not data.get("lock"):
        return mechanism
    try:
        return lock(mechanism, data["lock"], angle_unit=data["angle_unit"])
    except ModelError as error:
        raise document.fault(("lock",), str(error)) from None


def _where(document: Document, folder: Path) -> str | Path:
    """Return the name or the path of the mechanism of a study."""
    wanted = str(document.data["mechanism"])
    is_shipped = any(wanted in pack.files for pack in shipped())
    return wanted if is_shipped else folder / wanted


def _mechanism(document: Document, folder: Path) -> Mechanism:
    wanted = document.data["mechanism"]
    try:
        path = find(_where(document, folder))
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


def _ranged(document: Document, driven: Input) -> Input:
    """Return an input over the range that the study gives it."""
    path, item = ("inputs", driven.pair), document.data["inputs"][driven.pair]
    start, stop = (
        angle_at(document, (*path, key), item[key], document.data["angle_unit"])
        if key in item
        else default
        for key, default in (("from", driven.start), ("to", driven.stop))
    )
    if start == stop:
        raise document.fault(
            path,
            f"the range from `from` to `to` is empty, both are {start:.6g} rad; give "
            "another `to`, greater or less",
        )
    return Input(driven.pair, start, stop)


def _samples(document: Document, mechanism: Mechanism) -> int | tuple[int, ...]:
    samples = document.data.get("samples", DEFAULT_SAMPLES)
    if not isinstance(samples, list):
        return int(samples)
    if len(samples) != len(mechanism.inputs):
        raise document.fault(
            ("samples",),
            f"has {len(samples)} numbers for {len(mechanism.inputs)} inputs "
            f"({listing(item.pair for item in mechanism.inputs)})",
        )
    return tuple(int(count) for count in samples)


def _input_path(document: Document, mechanism: Mechanism) -> Floats | None:
    """Return the inputs' values (samples, inputs) in rad, if given."""
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
    return np.array(columns).T


def _path(document: Document, output: Mapping[str, str], key: str) -> Path | None:
    if key not in output:
        return None
    if not output[key].isprintable():
        raise document.fault(("output", key), f"{output[key]!a}: not a usable path")
    return Path(output[key])
