"""Command-line arguments that `run`, `sweep`, `trade`, `explain` and others share.

`study_from` applies them to a study or mechanism file. An argument that is stated replaces
the value in the file.
"""

from argparse import ArgumentParser, Namespace
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from spherekit.cli.argument_types import sample_counts, seconds
from spherekit.cli.completers import complete_pairs, complete_studies, set_completer
from spherekit.quantity import ANGLE, QuantityError, read_quantity

if TYPE_CHECKING:
    from spherekit.files.study import Study
    from spherekit.files.time_law import Law
    from spherekit.mechanism.mechanism import Mechanism
    from spherekit.quantity import AngleUnit

UNIT_RULE = "a number without a unit is in the unit of the file"
"""The rule for angles and their rates, as the help texts of options state it."""

COPIED_FIELDS = ("samples", "start", "duration", "crossings", "assembly_mode")
"""Fields of `Study` whose command-line arguments have the same name and value."""


def add_lock_argument(parser: ArgumentParser) -> None:
    """Add ``--lock``."""
    parser.add_argument(
        "--lock",
        metavar="PAIR=VALUE",
        action="append",
        help=(
            "lock an R pair at an angle, such as 21=30deg, so that its two links become "
            "one; may be repeated; "
            f"{UNIT_RULE}"
        ),
    )


def add_input_argument(parser: ArgumentParser) -> None:
    """Add ``--input``."""
    input_argument = parser.add_argument(
        "--input",
        metavar="PAIR",
        action="append",
        help=(
            "drive this pair instead of the inputs of the file; give the option once for "
            "each degree of freedom"
        ),
    )
    set_completer(input_argument, complete_pairs)


def add_study_arguments(parser: ArgumentParser) -> None:
    """Add arguments that several commands share: file, samples, inputs and locked pairs.

    The options are ``--samples``, ``--input`` and ``--lock``.
    """
    file_argument = parser.add_argument(
        "file",
        metavar="FILE|STUDY",
        help="mechanism or study: path of a file, or name of a shipped one",
    )
    set_completer(file_argument, complete_studies)
    parser.add_argument(
        "--samples",
        metavar="N[xM...]",
        type=sample_counts,
        help=(
            "number of samples over the range of the input (default: 361). With "
            "several inputs, N gives N samples while all inputs move together from the "
            "start to the end of their ranges, and NxM, such as 41x21, gives a grid"
        ),
    )
    add_input_argument(parser)
    add_lock_argument(parser)


def add_time_arguments(parser: ArgumentParser) -> None:
    """Add the arguments for the motion in time and for the assembly modes.

    The motion is prescribed by time laws of the inputs, or simulated from a start under
    loads and driving torques. An assembly mode is one of the ways to assemble the
    mechanism at given inputs. It is labelled by the signs of its dyads: the two ways to
    assemble two links between two known axes.
    """
    parser.add_argument(
        "--law",
        metavar="[PAIR=]KIND:key=value,...",
        action="append",
        help=(
            "motion of an input over time, such as "
            "cycloidal:from=0deg,to=90deg,duration=2. Kinds and their keys: "
            "constant_speed (speed, from); polynomial (coefficients); cycloidal (from, "
            "to, duration); table (times, angles, rest_at_ends). Values of a list are "
            "joined by +, such as times=0+1+2. Times are in s; "
            f"{UNIT_RULE}"
        ),
    )
    parser.add_argument(
        "--start",
        metavar="q=Q[,dq=W]",
        help=(
            "simulate from this state of the input at t = 0, such as "
            "q=20deg,dq=1rad/s; values of several inputs are joined by +, such as "
            "q=20deg+35deg,dq=1rad/s+0rad/s. The motion follows from the loads; "
            f"{UNIT_RULE}"
        ),
    )
    parser.add_argument(
        "--torque",
        metavar="[PAIR=]EXPR",
        action="append",
        help=(
            "for a simulation (--start): driving torque in N m at an input, as an "
            "expression such as 21=-0.1*dtheta_21; an input without a torque turns freely"
        ),
    )
    # The samples divide the duration into equal time steps.
    parser.add_argument(
        "--duration",
        metavar="T",
        type=seconds,
        help=(
            "duration of the motion in s; samples are equally spaced in time. If neither "
            "--law nor --start is given, the input turns at 1 rad/s"
        ),
    )
    parser.add_argument(
        "--crossings",
        choices=("end", "pass"),
        help=(
            "what happens to an assembly mode where two curves of configurations cross. A "
            "dyad (two links) can be assembled in two ways, and its sign selects one of "
            "them. end (default) = the mode keeps the signs of its dyads and leaves "
            "its smooth curve; a simulation ends there. pass = the mode or the simulation "
            "follows the smooth curve, on which the sign of a dyad changes"
        ),
    )
    parser.add_argument(
        "--assembly-mode",
        metavar="N-or-NAME",
        help="compute only this assembly mode, given by its number or name",
    )
    parser.add_argument(
        "--no-search",
        action="store_true",
        help=("compute only the assembly mode of the reference pose, if the file has one"),
    )


def read_angle(option: str, text: str, angle_unit: "AngleUnit") -> float:
    """Return the angle (rad) that a text of an option states, such as ``30deg``.

    Parameters
    ----------
    option
        Name of the option, for error messages.
    text
        The text that the user wrote.
    angle_unit
        Unit of a number without a unit: the unit of the mechanism file.

    Raises
    ------
    AnalysisError
        If the text is no angle.
    """
    from spherekit.errors import AnalysisError

    try:
        return read_quantity(text, ANGLE, angle_unit)
    except QuantityError as problem:
        raise AnalysisError(f"{option}: {problem}") from None


def mechanism_options(options: Namespace) -> list[str]:
    """Return ``--input``, ``--lock`` and ``--crossings`` as words of a command line.

    The commands `run`, `page` and `export` have these options. A run suggests further
    commands to the user. With these words the suggested commands compute the same motion.
    """
    words = []
    for pair in options.input or []:
        words += ["--input", pair]
    for locked_pair in options.lock or []:
        words += ["--lock", locked_pair]
    if options.crossings:
        words += ["--crossings", options.crossings]
    return words


def with_locks(mechanism: "Mechanism", lock_texts: Sequence[str] | None) -> "Mechanism":
    """Return a mechanism in which the pairs (joints) named by ``--lock`` are locked.

    A locked pair has a constant angle, so its two links move as one.

    Parameters
    ----------
    mechanism
        The mechanism. Locked angles without a unit are in the unit of its file.
    lock_texts
        The values of ``--lock``, such as ``21=30deg``. If there are none, the mechanism
        itself is returned.

    Raises
    ------
    AnalysisError
        If a text does not read as ``PAIR=VALUE``, or if a pair has two values.
    ModelError
        If a pair cannot be locked at its value.
    """
    from spherekit.errors import AnalysisError
    from spherekit.mechanism.locking import lock

    if not lock_texts:
        return mechanism
    locked_angles: dict[str, float] = {}
    for text in lock_texts:
        pair, equals, value = text.partition("=")
        if not equals:
            raise AnalysisError(
                f'--lock: "{text}" does not read as PAIR=VALUE, such as 21=30 or 21=30deg; '
                f"{UNIT_RULE}"
            )
        if pair in locked_angles:
            raise AnalysisError(f"--lock {text}: pair {pair} has two values; give one")
        locked_angles[pair] = read_angle(f"--lock {pair}", value, mechanism.angle_unit)
    return lock(mechanism, locked_angles, angle_unit="rad")


def study_from(
    options: Namespace, further_fields: Mapping[str, Any] | None = None
) -> "Study":
    """Return the study of a file, changed by the arguments of the command line.

    The motion in time is either prescribed by time laws or computed by a simulation, which
    has a start and possibly torques. Arguments of the command line replace it:

    - Laws replace a simulation of the file, and a start replaces laws of the file.
    - A torque replaces the torque of a simulation of the file. If the file has no
      simulation, `check_time` refuses a torque without a start.

    Parameters
    ----------
    options
        Values of the arguments that `add_study_arguments` and perhaps `add_time_arguments`
        declare.
    further_fields
        Values for more fields of the study. A value of None leaves the field as it is.

    Raises
    ------
    AnalysisError
        If an argument cannot be read.
    ModelError, SpherekitError
        If the file cannot be read.
    """
    from spherekit.files.study_reader import load_study

    study = load_study(options.file)
    mechanism = with_locks(study.mechanism, options.lock)
    if options.input:
        mechanism = mechanism.with_inputs(*options.input)

    # Commands without the arguments of time have no such attributes.
    values = vars(options)
    fields: dict[str, Any] = {}
    # Fields such as `samples`, whose arguments have the same name and value.
    for name in COPIED_FIELDS:
        if values.get(name) is not None:
            fields[name] = values[name]
    for name, value in (further_fields or {}).items():
        if value is not None:
            fields[name] = value
    if values.get("no_search"):
        fields["search"] = False
    if options.lock or options.input or "samples" in fields:
        # A path in the file only fits the inputs and the number of samples of the file.
        fields["path"] = None
    study = replace(study, mechanism=mechanism)

    if values.get("law"):
        fields["laws"] = laws_of(options.law, study)
        # The simulation of the file is removed. A simulation of the command line stays, so
        # that `check_time` refuses it beside the laws.
        fields.setdefault("start", None)
        fields.setdefault("torque", None)
    elif "start" in fields:
        fields["laws"] = {}
    if values.get("torque"):
        fields["torque"] = torque_of(options.torque, study)
    return replace(study, **fields)


def laws_of(law_texts: Sequence[str], study: "Study") -> dict[str, "Law"]:
    """Return the time laws that the option ``--law`` states, by input.

    A time law is the prescribed motion of an input. The text is
    ``[PAIR=]KIND:key=value,...``, such as ``21=cycloidal:from=0,to=1,duration=2``.

    Parameters
    ----------
    law_texts
        The values of ``--law``.
    study
        The study, whose mechanism has the inputs.

    Raises
    ------
    AnalysisError
        If the kind is unknown, a key or value is wrong, or an input has two laws. Also if
        the input is left out although the mechanism has several inputs.
    """
    from spherekit.errors import AnalysisError, ModelError
    from spherekit.files.time_law import LAW_KINDS, make_field_readers
    from spherekit.files.units import KEYS
    from spherekit.planning.assembly_plan import driven_pairs
    from spherekit.runs.parameter_text import parse_fields
    from spherekit.wording import choices, listing

    inputs = study.mechanism.names_of(driven_pairs(study.mechanism))
    laws: dict[str, Law] = {}
    for text in law_texts:
        pair_and_kind, _, parameter_text = text.partition(":")
        pair, _, kind = pair_and_kind.rpartition("=")  # the pair is empty if left out
        if kind not in LAW_KINDS:
            raise AnalysisError(
                f'--law: "{kind}" is not a law{choices(kind, LAW_KINDS, "Laws")}'
            )
        # Some keys differ from the fields of the class, such as the key `from` for `start`.
        key_of_field = {field: key for key, field in KEYS[LAW_KINDS[kind]].items()}
        # Functions that read the value of a field, with its unit if there is one.
        readers = make_field_readers(study.mechanism.angle_unit)
        parameters = parse_fields(
            parameter_text,
            LAW_KINDS[kind],
            f"--law {kind}",
            key_of_field,
            readers=readers,
        )
        try:
            law = LAW_KINDS[kind](**parameters)
        except ModelError as problem:
            raise AnalysisError(f"--law {kind}: {problem}") from None
        if not pair and len(inputs) > 1:
            raise AnalysisError(
                f"--law: there are several inputs ({listing(inputs)}); write PAIR={text}"
            )
        pair = pair or inputs[0]
        if pair in laws:
            raise AnalysisError(f"--law {text}: input {pair} has two laws; give one")
        laws[pair] = law
    return laws


def torque_of(torque_texts: Sequence[str], study: "Study") -> "str | dict[str, str]":
    """Return the driving torques that the option ``--torque`` states.

    The text is ``[PAIR=]EXPR``: the input, and an expression for the torque.

    Parameters
    ----------
    torque_texts
        The values of ``--torque``.
    study
        The study. Error messages list its inputs.

    Returns
    -------
    The expression itself if a single torque is stated without an input. Otherwise the
    expressions by input.

    Raises
    ------
    AnalysisError
        If one of several torques names no input, or if an input has two torques.
    """
    from spherekit.errors import AnalysisError
    from spherekit.wording import listing

    if len(torque_texts) == 1 and "=" not in torque_texts[0]:
        return torque_texts[0]
    torques: dict[str, str] = {}
    for text in torque_texts:
        pair, equals, torque = text.partition("=")
        if not equals or pair in torques:
            raise AnalysisError(
                f'--torque: "{text}" names no input, or an input that already has a '
                "torque; write PAIR=EXPR once for each input "
                f"({listing(study.mechanism.input_pairs)})"
            )
        torques[pair] = torque
    return torques
