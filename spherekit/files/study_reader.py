"""A study from a TOML file of format 1: a mechanism and what is to be run on it."""

import os
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from spherekit.argument_validation import checked
from spherekit.arrays import Floats
from spherekit.conventions import DEFAULT_SAMPLES, AnyPath
from spherekit.errors import FileError, ModelError
from spherekit.files.library import STUDY_SUFFIX, find, is_study, named_in
from spherekit.files.mechanism_reader import angle_unit_of, load
from spherekit.files.schema import check
from spherekit.files.study import Start, Study
from spherekit.files.time_law import KINDS, Law, Tabulated
from spherekit.files.toml_document import Document, Table, parse, read_text
from spherekit.files.toml_lines import KeyPath
from spherekit.files.units import converted, made
from spherekit.mechanism.elements import Input
from spherekit.mechanism.locking import lock
from spherekit.mechanism.mechanism import Mechanism
from spherekit.mechanism.sizes import AngleUnit
from spherekit.wording import choices, listing

Subject = Study | Mechanism | str | os.PathLike[str]
"""What is run: a study, a mechanism, or the path or shipped name of either."""

_FIELDS = ("assembly_mode", "search", "duration", "tolerance", "crossings", "verify")
"""Keys that are fields of a study as they stand."""


@checked(FileError)
def load_study(name_or_path: AnyPath) -> Study:
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
    return _Reader(document, converted(document, document.data, "study")).study(path)


def study_of(subject: Subject) -> Study:
    """Return a study, given as such, or that of a mechanism, or read as `load_study`."""
    if isinstance(subject, Study):
        return subject
    if isinstance(subject, Mechanism):
        return Study(subject.name, subject)
    return load_study(subject)


def angle_unit_of_mechanism(name_or_path: AnyPath) -> AngleUnit:
    """Return the unit of the angles in a mechanism file, or in that of a study."""
    path = find(name_or_path)
    if is_study(path):
        document = parse(read_text(path), str(path))
        path = find(named_in(document.data["mechanism"], path.parent))
    return angle_unit_of(path)


@dataclass(frozen=True)
class _Reader:
    """Builds a study from data that fits the schema, converted as the model has it."""

    document: Document
    data: Table

    def study(self, path: Path) -> Study:
        data, start = self.data, self.data.get("start", {})
        mechanism = self.driven(self.locked(self.mechanism(path.parent)))
        return Study(
            name=path.name.removesuffix(STUDY_SUFFIX),
            mechanism=mechanism,
            samples=self.samples(mechanism),
            path=self.input_path(mechanism),
            analyses=self.document.data.get("analyses", {}),
            folder=self.path("folder"),
            recording=self.path("recording"),
            degrees=data.get("output", {}).get("degrees", False),
            laws={
                pair: self.law(("inputs", pair, "law"), item["law"])
                for pair, item in data.get("inputs", {}).items()
                if "law" in item
            },
            start=Start(start["q"], start.get("dq", 0.0)) if start else None,
            torque=start.get("torque"),
            locate=self.document.fault,
            **{key: data[key] for key in _FIELDS if key in data},
        )

    def mechanism(self, folder: Path) -> Mechanism:
        try:
            path = find(named_in(self.data["mechanism"], folder))
        except FileError as error:
            raise self.document.fault(("mechanism",), str(error)) from None
        if is_study(path):
            raise self.document.fault(
                ("mechanism",),
                f'found "{self.data["mechanism"]}", a study; needs a mechanism file',
            )
        return load(path)

    def locked(self, mechanism: Mechanism) -> Mechanism:
        """Return the mechanism with the pairs locked that the study locks."""
        if not self.data.get("lock"):
            return mechanism
        try:
            return lock(mechanism, self.data["lock"], angle_unit="rad")
        except ModelError as error:
            raise self.document.fault(("lock",), str(error)) from None

    def driven(self, mechanism: Mechanism) -> Mechanism:
        """Return the mechanism with the study's inputs and their ranges."""
        given = self.data.get("inputs", {})
        for pair in given:
            if pair not in mechanism.pair_number:
                raise self.document.fault(
                    ("inputs", pair),
                    f'{mechanism.name} has no pair "{pair}"'
                    f"{choices(pair, mechanism.pair_number, 'Pairs')}",
                )
        if not set(mechanism.input_pairs).issuperset(given):
            mechanism = mechanism.with_inputs(*given)
        ranged = []
        for item in mechanism.inputs:
            ends = made(
                Input,
                {"from": item.start, "to": item.stop, **given.get(item.pair, {})},
                {"pair": item.pair},
            )
            if item.pair in given and ends.start == ends.stop:
                raise self.document.fault(
                    ("inputs", item.pair),
                    "the range from `from` to `to` is empty, both are "
                    f"{ends.start:.6g} rad; give another `to`, greater or less",
                )
            ranged.append(ends)
        return replace(mechanism, inputs=tuple(ranged))

    def samples(self, mechanism: Mechanism) -> int | tuple[int, ...]:
        samples: int | tuple[int, ...] = self.data.get("samples", DEFAULT_SAMPLES)
        if isinstance(samples, tuple) and len(samples) != len(mechanism.inputs):
            raise self.document.fault(
                ("samples",),
                f"has {len(samples)} numbers for {len(mechanism.inputs)} inputs "
                f"({listing(mechanism.input_pairs)})",
            )
        return samples

    def input_path(self, mechanism: Mechanism) -> Floats | None:
        """Return the inputs' values (samples, inputs) in rad, if given."""
        given, fault = self.data.get("inputs", {}), self.document.fault
        if not any("values" in item for item in given.values()):
            return None
        columns: list[tuple[float, ...]] = []
        for item in mechanism.inputs:
            path, table = ("inputs", item.pair), given.get(item.pair, {})
            if "values" not in table:
                raise fault(
                    path if item.pair in given else ("inputs",),
                    f"input {item.pair} has no values, but another input has; give values "
                    "for every input",
                )
            for key in ("from", "to"):
                if key in table:
                    raise fault((*path, key), "excluded by values, which says every sample")
            columns.append(table["values"])
            if len(columns[-1]) != len(columns[0]):
                raise fault(
                    (*path, "values"),
                    f"has {len(columns[-1])} values, input {mechanism.inputs[0].pair} has "
                    f"{len(columns[0])}; give equally many",
                )
        if "samples" in self.data:
            raise fault(("samples",), "excluded by the inputs' values")
        return np.array(columns).T

    def law(self, path: KeyPath, item: Table) -> Law:
        kind: Callable[..., Law] = KINDS[item["kind"]]
        try:
            law = made(kind, item)
        except ModelError as error:
            key, _, message = str(error).partition(": ")
            raise self.document.fault((*path, key), message) from None
        duration = self.data.get("duration")
        if isinstance(law, Tabulated) and duration is not None:
            first, *_, last = law.times
            if first > 0 or last < duration:
                raise self.document.fault(
                    (*path, "times"),
                    f"has {first:g} to {last:g} s, but the study lasts from 0 to "
                    f"{duration:g} s; add rows, or change the duration",
                )
        return law

    def path(self, key: str) -> Path | None:
        output = self.data.get("output", {})
        if key not in output:
            return None
        if not output[key].isprintable():
            raise self.document.fault(
                ("output", key), f"{output[key]!a}: not a usable path"
            )
        return Path(output[key])
