"""Reads a study, a mechanism with the analyses to run, from a TOML file of format 1."""

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
from spherekit.files.mechanism_reader import load
from spherekit.files.schema import check
from spherekit.files.study import Start, Study
from spherekit.files.time_law import LAW_KINDS, Law, Tabulated
from spherekit.files.toml_document import Document, Table, parse, read_text
from spherekit.files.toml_lines import KeyPath
from spherekit.files.units import construct_element, convert_to_model
from spherekit.mechanism.elements import Input
from spherekit.mechanism.locking import lock
from spherekit.mechanism.mechanism import Mechanism
from spherekit.quantity import AngleUnit
from spherekit.wording import choices, counted, numbered

Subject = Study | Mechanism | str | os.PathLike[str]
"""A study, a mechanism, or the path or shipped name of either."""

_COPIED_KEYS = ("assembly_mode", "search", "duration", "tolerance", "crossings", "verify")
"""Keys whose values are fields of `Study` without conversion."""


@checked(FileError)
def load_study(name_or_path: AnyPath) -> Study:
    """Read a study file, or a mechanism file as a study with all defaults.

    A study is a mechanism with the analyses to run and their settings. If the file is a
    mechanism file, the result is a study of this mechanism in which all settings have their
    default values.

    Raises
    ------
    FileError
        If there is no such file, or if it has faults. The message has one line for each
        fault.
    """
    path = find(name_or_path)
    if not is_study(path):
        mechanism = load(path)
        return Study(mechanism.name, mechanism)
    document = parse(read_text(path), str(path))
    check(document, "study")
    mechanism = _mechanism_of(document, path.parent)
    # The unit of angles in the study file, by default that of the mechanism file.
    angle_unit: AngleUnit = document.data.get("angle_unit", mechanism.angle_unit)
    data = convert_to_model(document, document.data, "study", angle_unit)
    # The unit of the mechanism applies to parameters of analyses. In a study these are in
    # the unit of the study file.
    mechanism = replace(mechanism, angle_unit=angle_unit)
    return _StudyReader(document, data).construct_study(path, mechanism)


def study_of(subject: Subject) -> Study:
    """Return a study, the default study of a mechanism, or the study of a file."""
    if isinstance(subject, Study):
        return subject
    if isinstance(subject, Mechanism):
        return Study(subject.name, subject)
    return load_study(subject)


def _mechanism_of(document: Document, folder: Path) -> Mechanism:
    """Return the mechanism that a study names; paths are relative to a folder."""
    name = document.data["mechanism"]
    try:
        path = find(named_in(name, folder))
    except FileError as error:
        raise document.fault(("mechanism",), str(error)) from None
    if is_study(path):
        raise document.fault(
            ("mechanism",), f'found "{name}", which is a study; needs a mechanism file'
        )
    return load(path)


@dataclass(frozen=True)
class _StudyReader:
    """Constructs a study (a mechanism with the analyses to run) from the data of a file.

    Attributes
    ----------
    document
        The file, for messages.
    data
        The data of the file, which fits the schema, as `convert_to_model` returns it: with
        angles in rad and directions as unit vectors.
    """

    document: Document
    data: Table

    def construct_study(self, path: Path, mechanism: Mechanism) -> Study:
        """Return the study that the file contains: a mechanism with the analyses to run.

        Parameters
        ----------
        path
            Path of the file. The study has the name of the file, without the ending.
        mechanism
            The mechanism that the file names.
        """
        data = self.data
        # A study can lock pairs (joints) of the mechanism, and can choose other inputs
        # (driven pairs) than the mechanism file.
        mechanism = self.locked(mechanism)
        mechanism = self.with_inputs(mechanism)
        return Study(
            name=path.name.removesuffix(STUDY_SUFFIX),
            mechanism=mechanism,
            # The number of samples of the inputs, evenly spaced over their ranges.
            samples=self.samples(mechanism),
            # The values of the inputs at every sample, None if the file states ranges.
            path=self.input_values(mechanism),
            # Parameters of analyses are unconverted, because only the analyses know the
            # types.
            analyses=self.document.data.get("analyses", {}),
            # Where results are written: a folder of tables, and a recording of the motion.
            folder=self.output_path("folder"),
            recording=self.output_path("recording"),
            # Whether tables of results have angles in degrees.
            degrees=data.get("output", {}).get("degrees", False),
            # Inputs as functions of time (laws), or the state at t = 0 of a simulation
            # (start), with the driving torque of this simulation.
            laws=self.time_laws(),
            start=self.start(),
            torque=data.get("start", {}).get("torque"),
            # A function by which later errors name the line of the file with their cause.
            locate=self.document.fault,
            **{key: data[key] for key in _COPIED_KEYS if key in data},
        )

    def locked(self, mechanism: Mechanism) -> Mechanism:
        """Return the mechanism with the pairs locked under the study's key ``lock``."""
        if not self.data.get("lock"):
            return mechanism
        try:
            return lock(mechanism, self.data["lock"], angle_unit="rad")
        except ModelError as error:
            raise self.document.fault(("lock",), str(error)) from None

    def with_inputs(self, mechanism: Mechanism) -> Mechanism:
        """Return the mechanism with the inputs of the study and their ranges.

        The inputs (driven pairs) of the mechanism remain if they include all input pairs of
        the study. Else the pairs of the study become the only inputs. Ends of ranges that
        the study does not state are taken from the mechanism.
        """
        input_tables = self.data.get("inputs", {})
        for pair in input_tables:
            if pair not in mechanism.pair_number:
                raise self.document.fault(
                    ("inputs", pair),
                    f'{mechanism.name} has no pair "{pair}"'
                    f"{choices(pair, mechanism.pair_number, 'Pairs')}",
                )
        if not set(mechanism.input_pairs).issuperset(input_tables):
            mechanism = mechanism.with_inputs(*input_tables)
        inputs = []
        for mechanism_input in mechanism.inputs:
            pair = mechanism_input.pair
            if pair not in input_tables:
                inputs.append(mechanism_input)
                continue
            default_range = {"from": mechanism_input.start, "to": mechanism_input.stop}
            study_input = construct_element(
                Input, {**default_range, **input_tables[pair]}, {"pair": pair}
            )
            if study_input.start == study_input.stop:
                raise self.document.fault(
                    ("inputs", pair),
                    "the range is empty, because `from` and `to` are both "
                    f"{study_input.start:.6g} rad; give a greater or smaller `to`",
                )
            inputs.append(study_input)
        return replace(mechanism, inputs=tuple(inputs))

    def samples(self, mechanism: Mechanism) -> int | tuple[int, ...]:
        """Return the number of samples, or one for each input of a grid."""
        samples: int | tuple[int, ...] = self.data.get("samples", DEFAULT_SAMPLES)
        if isinstance(samples, tuple) and len(samples) != len(mechanism.inputs):
            raise self.document.fault(
                ("samples",),
                f"has {counted(len(samples), 'number')}, but the mechanism has "
                f"{counted(len(mechanism.inputs), 'input')} "
                f"({numbered('pair', mechanism.input_pairs)}); give one number for each "
                "input",
            )
        return samples

    def input_values(self, mechanism: Mechanism) -> Floats | None:
        """Return the values of the inputs at every sample, if the study lists them.

        Returns
        -------
        (samples, inputs) values in rad: the lists ``values`` of the inputs in the study.
        None if no input has such a list.

        Raises
        ------
        FileError
            If only some inputs have a list, if the lists differ in length, or if the study
            also has ranges or a number of samples.
        """
        input_tables = self.data.get("inputs", {})
        fault = self.document.fault
        if not any("values" in table for table in input_tables.values()):
            return None
        columns: list[tuple[float, ...]] = []
        for item in mechanism.inputs:
            path = ("inputs", item.pair)
            table = input_tables.get(item.pair, {})
            if "values" not in table:
                raise fault(
                    path if item.pair in input_tables else ("inputs",),
                    f"input {item.pair} has no values, but another input has values; give "
                    "values for every input",
                )
            for key in ("from", "to"):
                if key in table:
                    raise fault(
                        (*path, key),
                        'cannot be given together with "values", which lists every '
                        f'sample; leave out "{key}" or "values"',
                    )
            column = table["values"]
            if columns and len(column) != len(columns[0]):
                raise fault(
                    (*path, "values"),
                    f"has {len(column)} values, but input {mechanism.inputs[0].pair} has "
                    f"{len(columns[0])}; give the same number of values for each input",
                )
            columns.append(column)
        if "samples" in self.data:
            raise fault(
                ("samples",),
                "cannot be given together with values of the inputs, which list every "
                "sample; leave out samples or the values",
            )
        return np.array(columns).T

    def start(self) -> Start | None:
        """Return the state in which the motion starts, None if the study has none."""
        table = self.data.get("start", {})
        return Start(table["q"], table.get("dq", 0.0)) if table else None

    def time_laws(self) -> dict[str, Law]:
        """Return the time laws that the study gives to inputs, by the names of the pairs.

        Raises
        ------
        FileError
            See `time_law`.
        """
        laws = {}
        for pair, table in self.data.get("inputs", {}).items():
            if "law" in table:
                key_path = ("inputs", pair, "law")  # names the table in messages
                laws[pair] = self.time_law(key_path, table["law"])
        return laws

    def time_law(self, path: KeyPath, item: Table) -> Law:
        """Return the time law of an input (its motion over time) from its table.

        Parameters
        ----------
        path
            Keys that lead to the table in the file, for messages.
        item
            The table, with the kind of the law (such as a polynomial) and its numbers.

        Raises
        ------
        FileError
            If the numbers do not fit the kind of the law, or if the times in a table do
            not cover the duration of the study.
        """
        kind: Callable[..., Law] = LAW_KINDS[item["kind"]]
        try:
            law = construct_element(kind, item)
        except ModelError as error:
            # Messages of time laws begin with the name of the field, which is the key.
            key, _, message = str(error).partition(": ")
            raise self.document.fault((*path, key), message) from None
        duration = self.data.get("duration")
        if isinstance(law, Tabulated) and duration is not None:
            first, *_, last = law.times
            if first > 0 or last < duration:
                raise self.document.fault(
                    (*path, "times"),
                    f"covers {first:g} to {last:g} s, but the study lasts from 0 to "
                    f"{duration:g} s; add rows, or change the duration",
                )
        return law

    def output_path(self, key: str) -> Path | None:
        """Return the path under a key of the table ``output``, if it is stated."""
        output = self.data.get("output", {})
        if key not in output:
            return None
        if not output[key].isprintable():
            raise self.document.fault(
                ("output", key),
                f"found {output[key]!a}, which cannot be a path, because it has "
                "characters that cannot be printed",
            )
        return Path(output[key])
