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

PLACED = re.compile(r"damaged\.toml(:\d+)?: \S")
TEXTS = st.text(max_size=60) | st.text(alphabet="[]{}\"=.#\n\\'ab1 ", max_size=40)


@pytest.mark.slow
@settings(max_examples=100 * EFFORT)
@given(files | TEXTS)
def test_damaged_mechanism_files(text):
    """Read a text; what is refused names file and line, what is read can be written."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        try:
            made = loads(text, "damaged.toml")
        except FileError as error:
            message = str(error)
            assert all(PLACED.match(line) for line in message.split("\n")), message
            assert len(message) < 4000
            assert all(character.isprintable() for character in message.replace("\n", ""))
            return
        assert is_toml(text.replace("\r\n", "\n").removeprefix("\ufeff"))
        assert loads(dumps(made)) == made


@settings(max_examples=100)
@given(data=st.binary(max_size=80), start=st.booleans())
def test_bytes_of_any_kind(tmp_path_factory, data, start):
    path = tmp_path_factory.getbasetemp() / "damaged.toml"
    path.write_bytes(FILES["four_bar.toml"].encode() * start + data)
    try:
        made = load(path)
    except FileError as error:
        assert "damaged.toml" in str(error)
        return
    assert loads(dumps(made)) == made


@settings(max_examples=60)
@given(files)
def test_damaged_study_files(tmp_path_factory, text):
    path = tmp_path_factory.getbasetemp() / "damaged.study.toml"
    path.write_text(text, encoding="utf-8", errors="surrogatepass", newline="")
    try:
        load_study(str(path))
    except SpherekitError as error:
        assert "damaged.study.toml" in str(error)


def test_every_shipped_file_is_where_damage_starts():
    assert len(FILES) > 20 and {"four_bar.toml", "stephenson_output.study.toml"} <= {*FILES}


@settings(max_examples=400 * EFFORT)
@given(expressions | st.text(max_size=30))
def test_expressions_of_loads(text):
    names = load_names(["a", "b"])
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        try:
            made = parse(text, names)
        except ModelError as error:
            assert re.match(r"column \d+: ", str(error)), str(error)
            assert len(str(error)) < 1000
            return
        assert made.names <= set(names)
        at = {name: 0.3 + 0.1 * k for k, name in enumerate(names)}
        array = made.evaluate(at)
        assert array.shape == () and array.dtype == np.float64
        try:
            value = expression_as_function(made, names)(list(at.values()))
            assert np.isclose(value, array, rtol=1e-9, atol=1e-12, equal_nan=True)
        except (ValueError, ArithmeticError, EngineError):
            assert not np.isfinite(array)
