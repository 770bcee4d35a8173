"""Files, expressions and bytes made by hypothesis: sound, or refused in words."""

import re
import warnings

import numpy as np
import pytest
from helpers.expressions import expression_as_function
from helpers.hypothesis_strategies import EFFORT, FILES, expressions, files, is_toml
from hypothesis import given, settings
from hypothesis import strategies as st

from spherekit.errors import EngineError, FileError, ModelError, SpherekitError
from spherekit.files.mechanism_reader import load, loads
from spherekit.files.mechanism_writer import dumps
from spherekit.files.study_reader import load_study
from spherekit.mechanism.load_expression import load_names, parse

FAULT_WITH_PLACE = re.compile(r"damaged\.toml(:\d+)?: \S")
"""Beginning of a message that names the file and, if it has one, the line."""
TEXTS = st.text(max_size=60) | st.text(alphabet="[]{}\"=.#\n\\'ab1 ", max_size=40)


@pytest.mark.slow
@settings(max_examples=100 * EFFORT)
@given(files | TEXTS)
def test_damaged_mechanism_files_are_refused_with_their_place_or_can_be_written(text):
    """A damaged mechanism file is refused in words, or read and written without change.

    `text` is a shipped file with random damage, or random text, drawn by hypothesis. A
    refusal has one short, printable line for each fault, with the line in the file. A file
    that is read must be valid TOML.
    """
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        try:
            mechanism = loads(text, "damaged.toml")
        except FileError as error:
            message = str(error)
            for line in message.split("\n"):
                assert FAULT_WITH_PLACE.match(line), message
                assert all(character.isprintable() for character in line), message
            assert len(message) < 4000
            return
        assert is_toml(text.replace("\r\n", "\n").removeprefix("\ufeff"))
        assert loads(dumps(mechanism)) == mechanism


@pytest.mark.slow
@settings(max_examples=100)
@given(data=st.binary(max_size=80), follows_a_file=st.booleans())
def test_random_bytes_are_refused_or_read_as_a_mechanism(
    tmp_path_factory, data, follows_a_file
):
    """The bytes are a whole file or are appended to a correct one."""
    path = tmp_path_factory.getbasetemp() / "damaged.toml"
    beginning = FILES["four_bar.toml"].encode() if follows_a_file else b""
    path.write_bytes(beginning + data)
    try:
        mechanism = load(path)
    except FileError as error:
        assert "damaged.toml" in str(error)
        return
    assert loads(dumps(mechanism)) == mechanism


@pytest.mark.slow
@settings(max_examples=60)
@given(files)
def test_damaged_study_files_are_read_or_refused_by_their_name(tmp_path_factory, text):
    path = tmp_path_factory.getbasetemp() / "damaged.study.toml"
    path.write_text(text, encoding="utf-8", errors="surrogatepass", newline="")
    try:
        load_study(str(path))
    except SpherekitError as error:
        assert "damaged.study.toml" in str(error)


def test_shipped_mechanisms_and_studies_are_the_files_that_are_damaged():
    assert len(FILES) > 20
    assert {"four_bar.toml", "stephenson_output.study.toml"} <= {*FILES}


@settings(max_examples=400 * EFFORT)
@given(expressions | st.text(max_size=30))
def test_random_load_expressions_are_refused_with_their_column_or_evaluated(text):
    """A random formula of a load is refused with the column of the fault, or evaluated.

    hypothesis draws the text. Both ways of evaluation must agree: on arrays, and as a
    function of floats. If the function of floats raises an error, the array has no finite
    value.
    """
    names = load_names(["a", "b"])
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        try:
            expression = parse(text, names)
        except ModelError as error:
            assert re.match(r"column \d+: ", str(error)), str(error)
            assert len(str(error)) < 1000
            return
        assert expression.names <= set(names)
        values = {name: 0.3 + 0.1 * k for k, name in enumerate(names)}
        array = expression.evaluate(values)
        assert array.shape == ()
        assert array.dtype == np.float64
        try:
            number = expression_as_function(expression, names)(list(values.values()))
            assert np.isclose(number, array, rtol=1e-9, atol=1e-12, equal_nan=True)
        except (ValueError, ArithmeticError, EngineError):
            assert not np.isfinite(array)
