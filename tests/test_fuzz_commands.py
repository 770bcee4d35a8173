"""Command lines made by hypothesis end in a documented status, without a trace."""

import contextlib
import io
import warnings

import pytest
from helpers.hypothesis_strategies import EFFORT, FILES, commands, damaged
from hypothesis import given, settings
from hypothesis import strategies as st

from spherekit.cli.main import main

STATUSES = {0, 1, 2, 3, 4}
DAMAGED = ("four_bar.toml", "stephenson_output.study.toml")


@pytest.mark.slow
@settings(max_examples=60 * EFFORT)
@given(commands(), st.sampled_from(DAMAGED).flatmap(damaged))
def test_command_lines(tmp_path_factory, words, text):
    """Run a command in this process; only what the grammar refuses leaves by SystemExit."""
    folder = tmp_path_factory.getbasetemp()
    for name in ("damaged.toml", "damaged.study.toml"):
        (folder / name).write_text(text, encoding="utf-8", errors="replace", newline="")
    paths = {
        "DAMAGED": str(folder / "damaged.toml"),
        "DAMAGED.study.toml": str(folder / "damaged.study.toml"),
        "OUT": str(folder / "out"),
    }
    out, err = io.StringIO(), io.StringIO()
    with (
        contextlib.redirect_stdout(out),
        contextlib.redirect_stderr(err),
        warnings.catch_warnings(),
    ):
        warnings.simplefilter("error", RuntimeWarning)
        try:
            status = main([paths.get(word, word) for word in words])
        except SystemExit as left:
            status = left.code
            assert status in (0, 2)
    assert status in STATUSES, words
    assert "Traceback" not in err.getvalue() and "Warning" not in err.getvalue()
    if status == 1:
        assert err.getvalue().startswith("spherekit: ")


def test_what_is_no_recording_is_not_shown(tmp_path, capsys):
    path = tmp_path / "four_bar.rrd"
    path.write_text(FILES["four_bar.toml"])
    assert main(["view", str(path)]) == 1
    assert "is not a recording; make one: run FILE --save X.rrd" in capsys.readouterr().err
