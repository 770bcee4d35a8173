"""The study that the flags of `run`, `trade` and `explain` make of a file."""

from argparse import Namespace
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from spherekit.files.study import Study
    from spherekit.files.time_law import Law
    from spherekit.mechanism.mechanism import Mechanism

LOCK = """
--lock PAIR=VALUE ...
    lock an R pair at a value of its variable, in the unit of the mechanism file, so that
    its two links are one
"""

INPUT = """
--input PAIR ...
    a driven pair, once for each freedom (default: the file's)
"""

STUDY = (
    """
FILE|STUDY
    mechanism or study: path or shipped name
--samples N[xM...]
    samples along the input's range, default 361; with several inputs on the straight path
    through their ranges, or on a grid with 41x21
"""
    + INPUT
    + LOCK
)
"""What `run`, `sweep`, `trade` and `explain` are of."""

TIMED = """
--law [PAIR=]KIND:key=value,... ...
    time law of an input: constant_speed:speed=,from= polynomial:coefficients=a+b+c
    cycloidal:from=,to=,duration= table:times=a+b,angles=a+b,rest_at_ends=; angles in rad,
    times in s
--start q=Q[,dq=W]
    state of the input at t = 0 in rad and rad/s, of several q=Q+Q,dq=W+W: the motion then
    follows from the loads
--torque [PAIR=]EXPR ...
    driving torque at an input, N m, with --start; others turn freely
--duration T
    time in s that the samples divide, for --law and --start; with neither the input turns
    at 1 rad/s
--crossings {end,pass}
    where curves of configurations cross: keep the signs of dyads, and with --start end
    there (end, the default); or follow the smooth curve through the crossing (pass)
--assembly-mode N-or-NAME
    only this assembly mode, by number or name
--no-search
    only the assembly mode of the reference pose, if the file gives one
"""
"""Laws of the inputs, a simulation's start and loads, the assembly mode."""

NONE: Mapping[str, Any] = {}
GIVEN = ("samples", "start", "duration", "crossings", "assembly_mode")
"""Fields of a study that flags say as they stand."""


def with_locks(
    mechanism: "Mechanism", texts: Sequence[str] | None, file: str
) -> "Mechanism":
    """Return a mechanism with the pairs locked that ``PAIR=VALUE`` name, if any."""
    from spherekit.errors import AnalysisError
    from spherekit.files.study_reader import angle_unit_of_mechanism
    from spherekit.mechanism.locking import lock

    if not texts:
        return mechanism
    pairs: dict[str, float] = {}
    for text in texts:
        pair, _, value = text.partition("=")
        try:
            pairs[pair] = float(value)
        except ValueError:
            raise AnalysisError(
                f'--lock: "{text}" does not read as PAIR=VALUE, such as 21=30, with a '
                "number in the unit of the mechanism file"
            ) from None
    return lock(mechanism, pairs, angle_unit=angle_unit_of_mechanism(file))


def study_from(options: Namespace, more: Mapping[str, Any] = NONE) -> "Study":
    """Return the study in which the flags given explicitly replace what the file says.

    `more` are other fields of it, those that are not None.
    """
    from spherekit.files.study_reader import load_study

    study = load_study(options.file)
    mechanism = with_locks(study.mechanism, options.lock, options.file)
    if options.input:
        mechanism = mechanism.with_inputs(*options.input)
    said = vars(options)
    given = {k: said[k] for k in GIVEN if said.get(k) is not None}
    given |= {k: value for k, value in more.items() if value is not None}
    if said.get("no_search"):
        given["search"] = False
    if options.lock or options.input or "samples" in given:
        given["path"] = None
    study = replace(study, mechanism=mechanism)
    if said.get("law"):
        laws = laws_of(options.law, study)
        given = {"start": None, "torque": None, **given, "laws": laws}
    elif "start" in given:
        given["laws"] = {}
    if said.get("torque"):
        given["torque"] = torque_of(options.torque, study)
    return replace(study, **given)


def laws_of(texts: Sequence[str], study: "Study") -> dict[str, "Law"]:
    """Return the time laws that ``[PAIR=]KIND:key=value,...`` gives, by input."""
    from spherekit.errors import AnalysisError, ModelError
    from spherekit.files.time_law import KINDS
    from spherekit.files.units import KEYS
    from spherekit.planning.assembly_plan import driven_pairs
    from spherekit.runs.parameter_text import given_in
    from spherekit.wording import choices, listing

    inputs = study.mechanism.names_of(driven_pairs(study.mechanism))
    laws: dict[str, Law] = {}
    for text in texts:
        head, _, keys = text.partition(":")
        pair, _, kind = head.rpartition("=")
        if kind not in KINDS:
            raise AnalysisError(f'--law: no law is "{kind}"{choices(kind, KINDS, "Laws")}')
        words = {field: key for key, field in KEYS[KINDS[kind]].items()}
        fields = given_in(keys, KINDS[kind], f"--law {kind}", words)
        try:
            law = KINDS[kind](**fields)
        except ModelError as problem:
            raise AnalysisError(f"--law {kind}: {problem}") from None
        if not pair and len(inputs) > 1:
            raise AnalysisError(
                f"--law: there are several inputs ({listing(inputs)}); write PAIR={text}"
            )
        laws[pair or inputs[0]] = law
    return laws


def torque_of(texts: Sequence[str], study: "Study") -> "str | dict[str, str]":
    """Return the driving torque that ``[PAIR=]EXPR`` gives, or that of each input."""
    from spherekit.errors import AnalysisError
    from spherekit.wording import listing

    if len(texts) == 1 and "=" not in texts[0]:
        return texts[0]
    torques: dict[str, str] = {}
    for text in texts:
        pair, equals, torque = text.partition("=")
        if not equals or pair in torques:
            raise AnalysisError(
                f'--torque: "{text}" does not say at which input it acts, or repeats it; '
                f"write PAIR=EXPR once for each ({listing(study.mechanism.input_pairs)})"
            )
        torques[pair] = torque
    return torques
