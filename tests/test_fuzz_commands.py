"""Command lines made by hypothesis end in a documented status, without a trace."""

import contextlib
import io
import warnings

import pytest
from helpers.hypothesis_strategies import EFFORT, FILES, commands, damaged
from hypothesis import given, settings
from hypothesis import strategies as st

from spherekit.cli.main import main

EXIT_STATUSES = {0, 1, 2, 3, 4}
"""Exit statuses that the documentation lists."""
DAMAGED = ("four_bar.toml", "stephenson_output.study.toml")


@pytest.mark.slow
@settings(max_examples=60 * EFFORT)
@given(commands(), st.sampled_from(DAMAGED).flatmap(damaged))
def test_random_command_lines_end_with_a_documented_exit_status(
    tmp_path_factory, words, text
):
    """No command prints a traceback or a warning, whatever its words and files are.

    hypothesis draws `words`, a command line in which DAMAGED, DAMAGED.study.toml and OUT
    stand for paths, and `text`, a mechanism or study file with random damage. The parser of
    the command line raises SystemExit, for words that it does not know (2) or --help (0).
    """
    folder = tmp_path_factory.getbasetemp()
    for name in ("damaged.toml", "damaged.study.toml"):
        (folder / name).write_text(text, encoding="utf-8", errors="replace", newline="")
    paths = {
        "DAMAGED": str(folder / "damaged.toml"),
        "DAMAGED.study.toml": str(folder / "damaged.study.toml"),
        "OUT": str(folder / "out"),
    }
    arguments = [paths.get(word, word) for word in words]
    out = io.StringIO()
    err = io.StringIO()
    with (
        contextlib.redirect_stdout(out),
        contextlib.redirect_stderr(err),
        warnings.catch_warnings(),
    ):
        warnings.simplefilter("error", RuntimeWarning)
        try:
            status = main(arguments)
        except SystemExit as system_exit:
            status = system_exit.code
            assert status in (0, 2)
    assert status in EXIT_STATUSES, words
    assert "Traceback" not in err.getvalue()
    assert "Warning" not in err.getvalue()
    if status == 1:
        assert err.getvalue().startswith("spherekit: ")


def test_view_refuses_a_file_that_is_no_recording(tmp_path, capsys):
    path = tmp_path / "four_bar.rrd"
    path.write_text(FILES["four_bar.toml"])
    assert main(["view", str(path)]) == 1
    assert (
        "this is not a recording; make a recording with: spherekit run FILE --save X.rrd"
        in capsys.readouterr().err
    )
