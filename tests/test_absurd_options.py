"""Every option of every command with absurd values: one sentence, or what it asks for.

The options are those of the parser, so a new option is tried without a change here. What is
accepted is listed by the meaning of the value; everything else has to be refused.
"""

import contextlib
import io
import re
import warnings
from pathlib import Path

import pytest

from spherekit.cli.command_line import COMMANDS, build_parser, command_parsers
from spherekit.cli.main import main

FILES = Path(__file__).parent / "files"
ANALYSIS = ["-a", "poles:only=4/1", "--samples", "3"]
BASE_ARGUMENTS = {
    "new": ["mechanism", "fresh"],
    "validate": ["four_bar"],
    "plan": ["four_bar"],
    "explain": ["four_bar", *ANALYSIS],
    "certify": ["four_bar", "--range", "10", "12"],
    "run": ["four_bar", *ANALYSIS],
    "sweep": ["four_bar", *ANALYSIS, "--vary", "links.2.arc=20,25", "--workers", "1"],
    "synthesize": [str(FILES / "synthesis_small.toml"), "--designs", "64", "--starts", "1"],
    "trade": ["four_bar", *ANALYSIS, "--rounds", "1"],
    "export": ["four_bar", "--to", "c"],
    "page": ["four_bar"],
    "import": [str(FILES / "spm45_ball.xml")],
    "view": [str(FILES / "sizes.toml"), "--png", "x.png"],
    "mechanisms": [],
    "analyses": [],
    "completion": ["bash"],
}
"""A command line of each command, to which an option is added."""

ABSURD = (
    "",
    "-1",
    "0",
    "99999999999999999999",
    "nan",
    "inf",
    "1e400",
    "text",
    "wrong.key=3",
    "folder",
    "rubbish.toml",
    "no/such/file.toml",
    "/proc/self/mem",
    ",",
    "=",
    "1x1x1",
    "é\u202e\n",
)
QUICK = ("99999999999999999999", "nan")
"""Values that are tried by default."""
SLOW = ("", "-1", "text", "folder", *QUICK)
"""Values that slow tests try, the others are for long ones."""

OPTIONS_LEFT_OUT = {"--help", "--version", "--view", "--web", "--serve"}
"""Options that are not tried: those with which no command is executed, and those that open
a window or serve a page."""
OUTPUT_OPTIONS = {"--output", "--out"}
"""These take any text, and write to a file or folder of that name."""

MEANINGFUL = {
    ("run", "--duration"): {"99999999999999999999"},
    ("sweep", "--duration"): {"99999999999999999999"},
    ("trade", "--duration"): {"99999999999999999999"},
    ("run", "--assembly-mode"): {"0"},
    ("sweep", "--assembly-mode"): {"0"},
    ("trade", "--assembly-mode"): {"0"},
    ("export", "--assembly-mode"): {"0"},
    ("run", "--tol"): {"99999999999999999999"},
    ("trade", "--tol"): {"99999999999999999999"},
    ("run", "--verify"): {"99999999999999999999"},  # all rows, as there are fewer
    ("sweep", "--seed"): {"0"},  # the default
    ("synthesize", "--seed"): {"0", "99999999999999999999"},
    ("synthesize", "--starts"): {"99999999999999999999"},
    ("sweep", "--workers"): {"99999999999999999999"},  # at most one for each part
    ("certify", "--tolerance"): {"0"},
    ("import", "--within"): {"99999999999999999999"},
    ("view", "--sample"): {"0"},
}
"""Values that mean what they say for an option."""

DECIDED_BY_ROUNDING = {("import", "--within"): {"0"}}
"""Values that are refused or not, depending on rounding: with 0, axes have to meet the
centre exactly."""

ENDLESS = {("trade", "--rounds"): {"99999999999999999999"}}
"""Values that ask for work without end, which reports how far it is and can be stopped."""


def options_of(command):
    """Return the actions of the parser of a command."""
    return command_parsers(build_parser(), [command])[command]._actions


def cases():
    """Yield a test case (command, option, value) for every option of every command.

    The values are the absurd ones of `ABSURD`. For a flag, which takes no value, the value
    is None, and the test repeats the flag. Few cases run by default; the others are marked
    as slow or long.
    """
    for command in COMMANDS:
        for action in options_of(command):
            names = [name for name in action.option_strings if name.startswith("--")]
            if set(names) & OPTIONS_LEFT_OUT or not names:
                continue
            name = names[0]
            is_quick_command = command not in ("trade", "view", "synthesize")
            if action.nargs == 0:
                yield pytest.param(
                    command,
                    name,
                    None,
                    id=f"{command} {name} twice",
                    marks=() if is_quick_command else pytest.mark.slow,
                )
                continue
            for value in ABSURD:
                if value in ENDLESS.get((command, name), ()):
                    continue
                printable_value = value.encode("unicode_escape").decode()
                if value in QUICK and is_quick_command:
                    marks = ()
                elif value in SLOW:
                    marks = pytest.mark.slow
                else:
                    marks = pytest.mark.long
                yield pytest.param(
                    command,
                    name,
                    value,
                    id=f"{command} {name} {printable_value}",
                    marks=marks,
                )


def run_command(words):
    """Run a command; return its exit status and what it printed to stderr.

    Runtime warnings of libraries are enabled, so that they would be printed too. The parser
    of the command line ends by `SystemExit`, which has the status.
    """
    output = io.StringIO()
    errors = io.StringIO()
    with (
        contextlib.redirect_stdout(output),
        contextlib.redirect_stderr(errors),
        warnings.catch_warnings(),
    ):
        warnings.simplefilter("always", RuntimeWarning)
        try:
            status = main(words)
        except SystemExit as exit_request:
            status = exit_request.code
    return status, errors.getvalue()


ALL_STATUSES = range(5)
"""Exit statuses of spherekit, from 0 for success to 4, as `docs/messages.md` lists them."""
ACCEPTED = (0,)
REFUSED = (1, 2)
"""A file or an argument does not allow the command (1), or the parser refuses it (2)."""


def allowed_statuses(command, option, value):
    """Return the exit statuses that a command may have for a value of an option.

    An option that names an output file takes any text. An option given twice (value None)
    may be accepted or refused.
    """
    if value is None or option in OUTPUT_OPTIONS:
        return ALL_STATUSES
    if value in MEANINGFUL.get((command, option), ()):
        return ACCEPTED
    if value in DECIDED_BY_ROUNDING.get((command, option), ()):
        return (0, 1)
    return REFUSED


def words_of_option(command, option, value):
    """Return an option with its value as words of the command line.

    If the option takes several values, all are equal. With the value None the option is
    given twice, without a value.
    """
    (action,) = (a for a in options_of(command) if option in a.option_strings)
    if value is None:
        return [option, option]
    if isinstance(action.nargs, int) and action.nargs > 1:
        return [option, *[value] * action.nargs]
    return [f"{option}={value}"]


@pytest.mark.parametrize(("command", "option", "value"), list(cases()))
def test_absurd_options_are_refused_in_a_sentence(
    command, option, value, tmp_path, monkeypatch
):
    """A command with an absurd value of an option ends without traceback or warning.

    It is refused in a sentence that begins with "spherekit", unless `allowed_statuses` says
    that the value may be accepted. `words_of_option` puts option and value together.
    """
    # Two of the values name a folder, and a file that no command can read. Both exist.
    monkeypatch.chdir(tmp_path)
    (tmp_path / "folder").mkdir()
    (tmp_path / "rubbish.toml").write_bytes(bytes(range(256)))

    option_words = words_of_option(command, option, value)
    status, errors = run_command([command, *BASE_ARGUMENTS[command], *option_words])

    assert "Traceback" not in errors
    assert not re.search(r"Warning\b|\.py:\d", errors)
    assert "spherekit did not expect this warning" not in errors, errors
    # A value with this character, which reverses the direction of text, is escaped.
    assert "\u202e" not in errors
    statuses = allowed_statuses(command, option, value)
    assert status in statuses, (status, errors)
    if statuses == REFUSED:
        assert errors.startswith("spherekit"), errors


@pytest.mark.parametrize("more", [[], ["--starts", "2"], ["--seed", "3"]])
def test_a_synthesis_that_reads_no_configuration_ends(more, tmp_path, monkeypatch):
    """An objective of sizes alone has no columns of configurations."""
    monkeypatch.chdir(tmp_path)
    words = [str(FILES / "synthesis_small.toml"), "--designs", "64", "--starts", "1", *more]
    status, errors = run_command(["synthesize", *words])
    assert status in (0, 1) and "Traceback" not in errors


def test_every_command_has_a_line_to_start_from():
    assert set(BASE_ARGUMENTS) == set(COMMANDS)


@pytest.mark.parametrize("shows_source", [False, True])
@pytest.mark.parametrize(
    ("expression", "words"),
    [
        ("np.float64(1.0) / np.float64(0.0)", "divide by zero encountered in"),
        ("np.log(np.float64(-1.0))", "invalid value encountered in log"),
        ("np.exp(np.float64(1e4))", "overflow encountered in exp"),
        ("np.array([1e300]) * 1e300", "overflow encountered in multiply"),
        ("np.nanmax(np.array([np.nan]))", "All-NaN"),
        ("np.mean(np.array([]))", "Mean of empty slice"),
    ],
)
def test_a_repeated_warning_of_numpy_is_printed_once_in_one_sentence(
    expression, words, shows_source, monkeypatch
):
    """A command in which NumPy warns three times prints the warning once, in one sentence.

    Instead of listing mechanisms, the command evaluates `expression` three times. `words`
    are part of NumPy's warning. With the option --traceback (`shows_source`), the sentence
    also names the file where the warning arose. This is a Python file of NumPy, or
    "<string>" for operations that `eval` itself does.
    """
    import numpy as np

    from spherekit.cli import mechanisms

    def evaluate_three_times(options):
        for _ in range(3):
            eval(expression, {"np": np})
        return 0

    monkeypatch.setattr(mechanisms, "execute", evaluate_three_times)
    command = ["mechanisms"]
    if shows_source:
        command.append("--traceback")
    status, errors = run_command(command)

    assert status == 0
    lines = [line for line in errors.splitlines() if words in line]
    assert len(lines) == 1, errors
    (line,) = lines
    assert line.startswith("spherekit: warning: ")
    # The sentence names the library in which the warning arose, and says that it "reports".
    assert "reports" in line
    assert ("it arose in" in line) == shows_source
    names_file = ".py" in errors or "<string>" in errors
    assert names_file == shows_source


@pytest.mark.parametrize(
    ("words", "fragments"),
    [
        (["run", "four_bar", "--samples", "9" * 20], ["samples: found 9", "at most"]),
        (["trade", "four_bar", "--samples", "9" * 30], ["samples: found 9", "at most"]),
        (["explain", "four_bar", "--samples", "9" * 20], ["samples: found 9", "at most"]),
        (["explain", "four_bar", "--samples", "1x1x1"], ["1x1x1 is for 3 inputs"]),
        (["explain", "five_bar", "--samples", "1x1x1"], ["but the mechanism has 2 inputs"]),
        (
            ["run", "five_bar", "--samples", "9999999x9999999"],
            ["samples: found 9999999x9999999", "at most"],
        ),
        (
            [
                "sweep",
                "four_bar",
                "--vary",
                "links.2.arc=1,2",
                "-a",
                "poles",
                "--seed",
                "7",
            ],
            ["seed: found 7", "a grid has no random numbers"],
        ),
        (
            ["sweep", "four_bar", "--vary", "links.2.arc=1:2", "--designs", "9" * 12],
            ["designs; at most", "1073741824"],
        ),
        (
            ["import", str(FILES / "spm45_ball.xml"), "--within", "inf"],
            ["within is inf", "a distance in m"],
        ),
        (
            ["certify", "four_bar", "--range", "10", "12", "--clear-of", "300"],
            ["--clear-of 300: outside the range that is proven", "10 to 12"],
        ),
    ],
)
def test_numbers_out_of_range_are_refused_with_the_reason(
    words, fragments, tmp_path, monkeypatch
):
    monkeypatch.chdir(tmp_path)
    status, errors = run_command(words)
    assert status == 1
    for fragment in fragments:
        assert fragment in errors, errors
