"""Strategies of hypothesis for files, expressions and command lines, valid or not."""

import os
import tomllib
from pathlib import Path

import spherekit_mechanisms
from hypothesis import HealthCheck, Phase, settings
from hypothesis import strategies as st

settings.register_profile(
    "repeatable",
    derandomize=True,
    deadline=None,
    database=None,
    print_blob=False,
    phases=(Phase.generate, Phase.shrink),
    suppress_health_check=list(HealthCheck),
)
settings.load_profile("repeatable")

EFFORT = int(os.environ.get("FUZZ_EFFORT", "1"))
"""Factor of the number of examples, by default 1."""
MECHANISMS = Path(spherekit_mechanisms.__path__[0])
FILES = {
    path.name: path.read_text(encoding="utf-8")
    for path in sorted(MECHANISMS.glob("*.toml"))
    if path.stat().st_size < 4000
}
"""The shipped mechanisms and studies, by the names of their files."""


def split(text, *more):
    """Return a list of the words of a text, followed by further words."""
    return [*text.split(), *more]


NUMBERS = (
    *split("nan inf -inf 1e400 -0.0 5e-324 1e308 -1e308 0 -1 1e-9 180 180.0 360.0"),
    *split("3.141592653589793 1_000 +1 1e-400 1. .5 01 true [] {} 1979-05-27"),
    *("9" * 400, "0x" + "f" * 60, '"1"'),
)
WORDS = (
    *split("1 R Cr Cs deg 21 base ../x a/b CON -rf é nan __class__"),
    *("", "a\\u0000b", "\\U0001F600", "\\u202e", " ", "a" * 300, "\\n"),
)

words = st.sampled_from(WORDS) | st.text(max_size=12)
numbers = st.sampled_from(NUMBERS) | st.floats().map(repr) | st.integers().map(str)
values = (
    numbers
    | words.map(lambda word: f'"{word}"')
    | st.lists(numbers, max_size=4).map(lambda items: "[" + ", ".join(items) + "]")
)


@st.composite
def damaged(draw, name):
    """Draw the text of a shipped file after one to three random changes of its lines.

    Tests check that such a file is read or refused in a sentence. A change may be harmless.
    hypothesis passes `draw`, a function that returns a random example of a strategy. `name`
    is a key of `FILES`, the name of the file. `words`, `numbers` and `values` above are
    strategies for parts of a line.
    """
    changes = (
        "replace the value",
        "replace the key",
        "empty the line",
        "double the line",
        "swap two lines",
        "add a line",
        "insert characters",
    )
    lines = FILES[name].split("\n")
    for _ in range(draw(st.integers(1, 3))):
        k = draw(st.integers(0, len(lines) - 1))
        key, equals, _ = lines[k].partition("=")
        change = draw(st.sampled_from(changes))
        if change == "replace the value" and equals:
            lines[k] = f"{key}= {draw(values)}"
        elif change == "replace the key" and equals:
            lines[k] = f"{draw(words)} {lines[k][len(key) :]}"
        elif change == "empty the line":
            lines[k] = ""
        elif change == "double the line":
            lines.insert(k, lines[k])
        elif change == "swap two lines":
            m = draw(st.integers(0, len(lines) - 1))
            lines[k], lines[m] = lines[m], lines[k]
        elif change == "add a line":
            lines.insert(k, f"{draw(words)} = {draw(values)}")
        else:  # also if a line without "=" has neither a key nor a value
            position = draw(st.integers(0, len(lines[k])))
            inserted = draw(st.text(max_size=2))
            lines[k] = lines[k][:position] + inserted + lines[k][position:]
    # "\n" is repeated, so that it is drawn most often.
    line_end = draw(st.sampled_from(("\n", "\n", "\n", "\r\n", "\r")))
    return line_end.join(lines)


files = st.sampled_from(sorted(FILES)).flatmap(damaged)

ATOMS = (
    *split("t theta_a dtheta_a theta_b pi 1 0.5 1e400 1e308 2 9**9 __import__('os')"),
    *split("t.real t[0] 1j True None 't' f't' x theta_é 0x10 1_0 ..."),
    *("lambda: 1", "t < 1", "t if t else 1", "t := 1", "t or 1"),
)
CALLS = split("sin cos tan asin sqrt exp log abs sign tanh eval")
atoms = st.sampled_from(ATOMS) | st.text(alphabet="()+-*/t1.,e ^=", max_size=8)
expressions = st.recursive(
    atoms,
    lambda inner: (
        st.tuples(inner, st.sampled_from([*"+-*/% ", "**", "//"]), inner).map("".join)
        | st.tuples(st.sampled_from(CALLS), inner).map(lambda pair: f"{pair[0]}({pair[1]})")
        | st.tuples(inner, inner).map(lambda pair: f"atan2({pair[0]}, {pair[1]})")
        | inner.map(lambda part: f"({part})")
        | inner.map(lambda part: f"-{part}")
    ),
    max_leaves=12,
)

SAFE = ("four_bar", "universal_joint", "bevel_pair", "five_bar", "nonsense", "", "/", ".")
sources = st.sampled_from((*SAFE, "DAMAGED", "DAMAGED.study.toml", "/dev/zero", "x" * 300))
small = st.sampled_from(split("1 2 3 5 2x2 0 -1 1x 1e9 x", "9" * 30, ""))
floats = st.sampled_from(split("nan inf -1 0 1e-3 1e-300 0.01 x 1e400", ""))
pairs = st.sampled_from(split("21 32 51 41 pinion_shaft nonsense - \0", ""))
ANALYSES = """poles eksergian nonsense poles:only=31 poles:only=99 poles:x=1 poles: :
    poles:only poles:only=31,only=21"""
analyses = st.sampled_from(ANALYSES.split())
LAWS = """constant_speed:speed=1 constant_speed:speed=nan constant_speed: x:y=1 = :
    polynomial:coefficients=1+2 cycloidal:from=0,to=1,duration=1 21=polynomial
    cycloidal:from=0,to=1,duration=0 table:times=0+1,angles=0+1
    table:times=0+1,angles=0+1,rest_at_ends=true polynomial:coefficients=1e300"""
laws = st.sampled_from(split(LAWS, ""))
starts = st.sampled_from(split("q=0 q=1,dq=0.1 q=nan q= dq=1 q=1e300 x", ""))
texts = st.sampled_from(split("0 t 2*sin(t) 1e400 x 9**9**9 (( 1/0", ""))
flags = st.one_of(
    st.tuples(st.just("--samples"), small),
    st.tuples(st.just("--input"), pairs),
    st.tuples(st.just("-a"), analyses),
    st.tuples(st.just("--law"), laws),
    st.tuples(st.just("--duration"), floats),
    st.tuples(st.just("--start"), starts),
    st.tuples(st.just("--torque"), texts),
    st.tuples(st.just("--tol"), floats),
    st.tuples(st.just("--assembly-mode"), small),
    st.sampled_from([("--no-search",), ("--deg",), ("--json",), ("--strict",), ("-q",)]),
    st.tuples(st.just("-o"), st.sampled_from(("OUT", "/dev/null/x", "\0", "", "/proc/x"))),
    st.tuples(st.just("--save"), st.sampled_from(("/dev/null/x.rrd", "/proc/x.rrd"))),
    st.tuples(words),
)


@st.composite
def commands(draw):
    """Draw the words of a random command line of any subcommand, valid or not.

    DAMAGED stands for the path of a damaged file, OUT for an output folder; the test
    replaces both. Runs have 3 samples unless an option says otherwise. hypothesis passes
    `draw`, a function that returns a random example of a strategy. The strategies are
    `sources` (mechanisms), `flags` (options with values), `analyses`, `floats` and `words`
    (any text).
    """
    # The words of the first text, then the other texts. Words that occur several times are
    # drawn more often.
    subcommands = split(
        "run run run run validate plan explain export view analyses analyses",
        "nonsense",
        "mechanisms",
    )
    subcommand = draw(st.sampled_from(subcommands))
    command = [subcommand]
    if subcommand in ("mechanisms", "nonsense"):
        command += draw(st.lists(words, max_size=2))
        return command
    if subcommand == "analyses":
        command += draw(st.lists(analyses | words, max_size=2))
        return command
    if subcommand == "view":
        recordings = ["DAMAGED", "nonsense", "/dev/zero", "", "/", "\0"]
        command.append(draw(st.sampled_from(recordings)))
        return command
    command.append(draw(sources))
    if subcommand == "export":
        command += ["--to", draw(st.sampled_from(("mjcf", "mjcf", "x")))]
        command += ["-o", draw(st.sampled_from(("OUT", "/dev/null/x", "\0", "/proc/x")))]
        options = draw(st.lists(flags | st.tuples(st.just("--at"), floats), max_size=1))
    else:
        if subcommand == "run":
            command += ["--samples", "3"]
        options = draw(st.lists(flags, max_size=3))
    for option in options:
        command += option
    return command


def is_toml(text):
    """Return whether Python's own TOML parser accepts a text."""
    try:
        tomllib.loads(text)
    except (tomllib.TOMLDecodeError, RecursionError, ValueError):
        return False
    return True
