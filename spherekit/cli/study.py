"""The study that the flags of `run`, `trade` and `explain` make of a file."""

import argparse
from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from spherekit.cli.suggest import analyses, pairs, studies, suggesting

if TYPE_CHECKING:
    from spherekit.model.mechanism import Mechanism
    from spherekit.model.study import Law, Study

GIVEN = (
    "samples",
    "laws",
    "start",
    "torque",
    "duration",
    "crossings",
    "assembly_mode",
    "search",
    "tolerance",
    "verify",
    "degrees",
    "folder",
    "recording",
)
"""Fields of a study that flags say, which have their names where they are parsed."""


def add_study_arguments(parser: argparse.ArgumentParser, timed: bool = True) -> None:
    """Declare what is run: a file, samples, inputs; if `timed`, laws and modes too."""
    suggesting(
        parser.add_argument(
            "file", metavar="FILE|STUDY", help="mechanism or study: path or shipped name"
        ),
        studies,
    )
    parser.add_argument(
        "--samples",
        type=sample_counts,
        metavar="N[xM...]",
        help="samples along the input's range, default 361; with several inputs on the "
        "straight path through their ranges, or on a grid with 41x21",
    )
    add_input_argument(parser)
    add_lock_argument(parser)
    if timed:
        _add_motion_arguments(parser)


def _add_motion_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare laws of the inputs, a simulation's start and loads, the assembly mode."""
    parser.add_argument(
        "--law",
        dest="laws",
        action="append",
        metavar="[PAIR=]KIND:key=value,...",
        help="time law of an input: constant_speed:speed=,from= polynomial:"
        "coefficients=a+b+c cycloidal:from=,to=,duration= table:times=a+b,angles=a+b,"
        "rest_at_ends=; angles in rad, times in s",
    )
    parser.add_argument(
        "--start",
        metavar="q=Q[,dq=W]",
        help="state of the input at t = 0 in rad and rad/s, of several q=Q+Q,dq=W+W: "
        "the motion then follows from the loads",
    )
    parser.add_argument(
        "--torque",
        action="append",
        metavar="[PAIR=]EXPR",
        help="driving torque at an input, N m, with --start; others turn freely",
    )
    parser.add_argument(
        "--duration",
        type=float,
        metavar="T",
        help="time in s that the samples divide, for --law and --start; with neither "
        "the input turns at 1 rad/s",
    )
    parser.add_argument(
        "--crossings",
        choices=("end", "pass"),
        help="with --start: end where sets of configurations cross (default), or go "
        "straight on",
    )
    parser.add_argument(
        "--assembly-mode", metavar="N", help="only this assembly mode, by number or name"
    )
    parser.add_argument(
        "--no-search",
        dest="search",
        action="store_const",
        const=False,
        help="only the assembly mode of the reference pose, if the file gives one",
    )


def add_input_argument(parser: argparse.ArgumentParser) -> None:
    """Declare ``--input PAIR``, once for each freedom."""
    suggesting(
        parser.add_argument(
            "--input",
            action="append",
            metavar="PAIR",
            help="a driven pair, once for each freedom (default: the file's)",
        ),
        pairs,
    )


def add_lock_argument(parser: argparse.ArgumentParser) -> None:
    """Declare ``--lock PAIR=VALUE``."""
    parser.add_argument(
        "--lock",
        action="append",
        metavar="PAIR=VALUE",
        help="lock an R pair at a value of its variable, in the unit of the mechanism "
        "file, so that its two links are one",
    )


def with_locks(
    mechanism: "Mechanism", texts: Sequence[str] | None, file: str
) -> "Mechanism":
    """Return a mechanism with the pairs locked that ``PAIR=VALUE`` name, if any."""
    from spherekit.errors import AnalysisError
    from spherekit.files.study import angle_unit_of_mechanism
    from spherekit.model.locking import lock

    if not texts:
        return mechanism
    pairs: dict[str, float] = {}
    for text in texts:
        pair, equals, value = text.partition("=")
        try:
            pairs[pair] = float(value)
        except ValueError:
            equals = ""
        if not equals:
            raise AnalysisError(
                f'--lock: "{text}" does not read as PAIR=VALUE, such as 21=30, with a '
                "number in the unit of the mechanism file"
            )
    return lock(mechanism, pairs, angle_unit=angle_unit_of_mechanism(file))


def add_analysis_argument(
    parser: argparse.ArgumentParser, words: str, repeated: bool = True
) -> None:
    """Declare ``-a NAME[:key=value,...]``, once or several times; `words` say what for."""
    suggesting(
        parser.add_argument(
            "-a",
            "--analysis",
            action="append" if repeated else "store",
            metavar="NAME[:key=value,...]",
            help=words,
        ),
        analyses,
    )


def sample_counts(text: str) -> int | tuple[int, ...]:
    """Return the number of samples that ``361`` or, for a grid, ``41x21`` names."""
    parts = text.split("x")
    if not all(part.isdecimal() and int(part) > 0 for part in parts):
        raise argparse.ArgumentTypeError(
            f"needs whole numbers of at least 1, such as 361 or 41x21, not {text!r}"
        )
    counts = tuple(int(part) for part in parts)
    return counts[0] if len(counts) == 1 else counts


def study_from(options: argparse.Namespace) -> "Study":
    """Return the study in which the flags given explicitly replace what the file says."""
    from spherekit.files.study import load_study

    study = load_study(options.file)
    mechanism = with_locks(study.mechanism, options.lock, options.file)
    if options.input is not None:
        mechanism = mechanism.with_inputs(*options.input)
    said = {name: getattr(options, name, None) for name in GIVEN}
    given: dict[str, Any] = {k: value for k, value in said.items() if value is not None}
    if options.lock or options.input is not None or "samples" in given:
        given["path"] = None
    study = replace(study, mechanism=mechanism)
    if "laws" in given:
        laws = laws_of(given["laws"], study)
        given = {"start": None, "torque": None, **given, "laws": laws}
    elif "start" in given:
        given["laws"] = {}
    if given.get("torque") is not None:
        given["torque"] = torque_of(given["torque"], study)
    return replace(study, **given)


def laws_of(texts: Sequence[str], study: "Study") -> dict[str, "Law"]:
    """Return the time laws that ``[PAIR=]KIND:key=value,...`` gives, by input."""
    from spherekit.analysis.arguments import given_in
    from spherekit.conventions import choices, listing
    from spherekit.errors import AnalysisError, ModelError
    from spherekit.files.units import KEYS
    from spherekit.model.study import KINDS
    from spherekit.planning.inputs import driven_pairs

    mechanism = study.mechanism
    inputs = mechanism.names_of(driven_pairs(mechanism))
    laws: dict[str, Law] = {}
    for text in texts:
        head, _, keys = text.partition(":")
        pair, _, kind = head.rpartition("=")
        if kind not in KINDS:
            said = choices(kind, KINDS, "Laws")
            raise AnalysisError(f'--law: no law is "{kind}"{said}')
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

    if len(texts) == 1 and "=" not in texts[0]:
        return texts[0]
    torques: dict[str, str] = {}
    for text in texts:
        pair, equals, torque = text.partition("=")
        if not equals or pair in torques:
            inputs = study.mechanism.input_pairs
            raise AnalysisError(
                f'--torque: "{text}" does not say at which input it acts, or repeats it; '
                f"write PAIR=EXPR once for each ({', '.join(inputs)})"
            )
        torques[pair] = torque
    return torques
