"""Faults in mechanism files: each names file, line, key, what is found and allowed."""

import os
import subprocess
import sys
from dataclasses import MISSING, fields
from pathlib import Path

import jsonschema
import numpy as np
import pytest
from helpers.refusals import mechanism_text, replace_passages

from spherekit.conventions import MAX_NAME_LENGTH
from spherekit.errors import FileError
from spherekit.files.mechanism_reader import load, loads
from spherekit.files.mechanism_writer import dumps
from spherekit.files.schema import schema
from spherekit.files.toml_document import MAX_BYTES
from spherekit.files.toml_lines import locate_keys
from spherekit.mechanism.joint import JOINT_KINDS
from spherekit.mechanism.load_expression import MAX_LENGTH
from spherekit.mechanism.load_kinds import LOADS
from spherekit.positions.position_analysis import PositionAnalysis

SIZES = mechanism_text("sizes")

POSE = mechanism_text("pose")


def refusal_message(text):
    """Return the message with which the text of a file x.toml is refused."""
    with pytest.raises(FileError) as caught:
        loads(text, "x.toml")
    return str(caught.value)


def test_the_file_with_sizes_reads_as_it_states():
    """The other tests of this module damage this file."""
    mechanism = loads(SIZES)
    assert mechanism.links == ("1", "2", "3", "4")
    assert mechanism.geometry.zeros == {"21": 3.141592653589793}  # 180 deg
    assert mechanism.inputs[0].start == 0.0
    assert mechanism.outputs[0].relative_to == "1"
    assert mechanism.user == {"note": "free"}


def test_the_file_with_axes_in_a_pose_reads_as_it_states():
    """The other tests of this module damage this file."""
    cam = loads(POSE)
    assert cam.geometry.axes == {"a": (0.0, 0.0, 1.0), "b": (0.0, 1.0, 0.0)}
    assert cam.pairs[2].profiles[1].centre == (0.0, 0.0, 1.0)


def test_a_missing_geometry_is_reported_at_its_pair():
    text = POSE.replace("xyz = [0.0, 0.0, 1.0]\nvalue = 10.0\n", "", 1)
    text = text.replace("lonlat = [90.0, 0.0]\n", "", 1)
    message = refusal_message(text)
    assert message.startswith("x.toml:8: pairs.a: no geometry: give axes and arcs")


def test_faults_are_listed_in_the_order_of_the_file():
    text = replace_passages(SIZES, 'type = "R"', 'type = "X"')
    text = replace_passages(text, "[user]", "[users]")
    faults = refusal_message(text).split("\n")
    assert [fault.split(": ")[0] for fault in faults] == ["x.toml:22", "x.toml:44"]


def test_many_faults_are_counted_after_the_first_ones():
    """Of 20 unknown tables, eight are listed."""
    text = SIZES + "".join(f"[x{k}]\n" for k in range(20))
    assert refusal_message(text).endswith("x.toml: and 12 more faults")
    text = SIZES + "".join(f"[x{k}]\n" for k in range(9))
    assert refusal_message(text).endswith("x.toml: and 1 more fault")


def test_byte_order_marks_and_windows_line_ends_do_not_matter():
    """Line numbers in messages stay correct."""
    text = "\ufeff" + SIZES.replace("\n", "\r\n")
    assert loads(text) == loads(SIZES)
    assert refusal_message(replace_passages(text, "70.5", "nan")).startswith("x.toml:16: ")


def test_user_data_may_have_any_keys_and_values():
    text = SIZES + "x = nan\nangle_unit = 7\ntype.R = [1979-05-27, {a = 1.5}]\n"
    user = loads(text).user
    assert user["angle_unit"] == 7
    assert type(user["type"]["R"][1]["a"]) is float


def test_a_byte_that_is_not_utf8_is_reported_with_line_and_offset(tmp_path):
    path = tmp_path / "x.toml"
    start = SIZES.encode()
    path.write_bytes(start + b'other = "\xff"\n')
    with pytest.raises(FileError) as caught:
        load(path)
    offset = len(start) + 9
    expected = f"{path}:46: the file is not UTF-8: byte 0xff at offset {offset}"
    assert expected in str(caught.value)


def test_a_file_in_utf16_is_refused_by_its_encoding(tmp_path):
    path = tmp_path / "x.toml"
    path.write_bytes(SIZES.encode("utf-16"))
    with pytest.raises(FileError, match="looks like UTF-16; save the file as UTF-8"):
        load(path)


def test_a_large_file_is_refused_before_it_is_parsed(tmp_path, monkeypatch):
    """The parser is replaced by None, so that calling it would fail."""
    path = tmp_path / "large.toml"
    with path.open("wb") as stream:
        stream.truncate(50_000_000)
    monkeypatch.setattr("tomllib.loads", None)
    with pytest.raises(FileError, match=f"found 50000000 bytes, but at most {MAX_BYTES}"):
        load(path)
    with pytest.raises(FileError, match="characters"):
        loads("#" * (MAX_BYTES + 1))


def test_a_folder_is_refused(tmp_path):
    with pytest.raises(FileError, match="is a folder"):
        load(tmp_path)


@pytest.mark.skipif(not Path("/dev/stdin").exists(), reason="no /dev/stdin")
def test_a_large_text_from_standard_input_is_refused_instead_of_cut():
    """The text has more bytes than are read, and as many characters as are allowed."""
    text = SIZES + "# " + "\u00e9" * 4
    text += "#" * (MAX_BYTES - len(text) - 1) + "\n[modes.lost]\n21 = 40.0\n"
    code = "import spherekit; print(spherekit.load('/dev/stdin').name)"
    done = subprocess.run(
        [sys.executable, "-c", code], input=text.encode(), capture_output=True, check=False
    )
    assert done.returncode == 1
    assert f"FileError: /dev/stdin: is too large; at most {MAX_BYTES}" in str(done.stderr)


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no pipes with names")
def test_a_pipe_is_refused(tmp_path):
    os.mkfifo(tmp_path / "pipe.toml")
    with pytest.raises(FileError, match="not a regular file"):
        load(tmp_path / "pipe.toml")


@pytest.mark.parametrize(
    ("line", "fragment"),
    [
        ("links.2.type = R", "text needs quotes"),
        ("links.2.arcs = [5.e1]", "a number needs a digit after its decimal point"),
        ("links.2.arcs = [5., 30]", "a number needs a digit after its decimal point"),
        ("pairs.2.one_sided = true,", "column 25: Expected newline"),
        ("[pairs.41.profiles.2", "column 21: Expected ']'"),
    ],
)
def test_hints_about_syntax_are_about_the_fault(line, fragment):
    """Dots between the parts of a key are no decimal points, and true is no text."""
    message = refusal_message(f"{line}\n# end\n")
    assert message.startswith("x.toml:1: column ")
    assert fragment in message


def test_a_repeated_table_is_named_if_its_name_has_a_quotation_mark():
    text = """["it's"]\n["it's"]\n"""
    expected = """x.toml:2: "it's": this table is given twice (first on line 1)"""
    assert refusal_message(text).startswith(expected)


def test_keys_with_long_escape_sequences_are_located_at_their_line():
    text = """a = 1\n"caf\\U000000e9" = 2\n"""
    assert locate_keys(text) == {("a",): 1, ("caf\u00e9",): 2}


def test_keys_of_every_toml_syntax_are_located_at_their_line():
    """Each key of a TOML file is located at its line, in every syntax of TOML.

    Messages about faults need these lines. The text has keys in quotes, with dots, in
    inline tables, and in arrays of tables. A key path has names and, for arrays, positions.
    Lines inside a text of several lines look like tables and keys (`x`, `y`) but are none.
    """
    text = """a = 1 # [not.a.table]
b."c d".'e' = \"\"\"
[x]
y = 1
\"\"\"
[t.u]  # comment
k = [ # ]
  1, "]", [2,
  3],
]
[[s]]
i = {a = 1, b.c = [2]}
[[s]]
[s.v]
w = '''a''''
z = "\\"[q]"
"""
    line_by_path = locate_keys(text)
    expected = {
        ("a",): 1,
        ("b", "c d", "e"): 2,
        ("t",): 6,
        ("t", "u"): 6,
        ("t", "u", "k"): 7,
        ("t", "u", "k", 1): 8,
        ("t", "u", "k", 2, 1): 9,
        ("s", 0, "i", "b", "c", 0): 12,
        ("s", 1): 13,
        ("s", 1, "v", "w"): 15,
        ("s", 1, "v", "z"): 16,
    }
    assert {path: line_by_path.get(path) for path in expected} == expected
    assert ("x",) not in line_by_path
    assert ("y",) not in line_by_path


SCHEMA_KINDS = pytest.mark.parametrize("kind", ["mechanism", "study", "synthesis"])


def parts_of_schema(root):
    """Yield a schema, its definitions (`$defs`), and the definitions in these."""
    yield root
    for definition in root.get("$defs", {}).values():
        yield from parts_of_schema(definition)


@SCHEMA_KINDS
def test_the_schema_is_valid_json_schema(kind):
    jsonschema.Draft202012Validator.check_schema(schema(kind))


@SCHEMA_KINDS
def test_every_key_of_the_schema_has_a_title_and_a_description(kind):
    for part in parts_of_schema(schema(kind)):
        for key, value in part.get("properties", {}).items():
            assert value.get("title"), key
            assert value.get("description", "").endswith("."), key


@SCHEMA_KINDS
def test_objects_of_the_schema_allow_no_unknown_keys(kind):
    """The schema of each object says so by the key `additionalProperties`.

    An object whose only property is `kind` chooses between other objects, which have
    further keys. It may leave `additionalProperties` out.
    """
    for part in parts_of_schema(schema(kind)):
        if part.get("type") != "object" or "properties" not in part:
            continue
        only_chooses = list(part["properties"]) == ["kind"]
        if only_chooses and "additionalProperties" not in part:
            continue
        assert part.get("additionalProperties") is False


def test_the_schema_has_the_limits_and_kinds_of_the_code():
    parts = schema()["$defs"]
    assert parts["name"]["maxLength"] == MAX_NAME_LENGTH
    assert parts["expression"]["maxLength"] == MAX_LENGTH
    assert set(parts["pair"]["properties"]["type"]["enum"]) == {*JOINT_KINDS, "P"}
    assert parts["load"]["properties"]["kind"]["enum"] == [*LOADS]


@pytest.mark.parametrize("kind", LOADS)
def test_the_schema_of_a_load_has_the_fields_of_its_class(kind):
    """Fields without a default value, in the class or in files, are required."""
    load_class = LOADS[kind]
    part = schema()["$defs"][f"load_{kind}"]
    fields_with_default = {
        field.name for field in fields(load_class) if field.default is not MISSING
    }
    optional = fields_with_default | set(load_class.defaults_in_files)
    assert set(part["properties"]) - {"kind"} == set(load_class.field_kinds)
    assert set(part["required"]) - {"kind"} == set(load_class.field_kinds) - optional


@pytest.mark.parametrize(
    "signed_arc, angle", [(-30.0, 270.0), (330.0, 270.0), (-330.0, 90.0)]
)
def test_a_signed_arc_means_the_shorter_arc_with_its_angle_turned_by_half_a_turn(
    signed_arc, angle
):
    """A negative arc means a positive one, with its angle turned by half a turn.

    An arc of more than 180 deg means a shorter one, also with its angle turned by half a
    turn. An arc of -330 deg has two half turns, so its angle stays. The second arc (deg) of
    the coupler leads from its first axis to its third. Its angle is 90 deg, about the first
    axis from the first arc. All links must have equal rotations at seven inputs (rad).
    """
    text = dumps(load("stephenson"))
    coupler = "arcs = [60.0, 30.0]\nangles = [90.0]\n"
    assert text.count(coupler) == 1
    signed_text = f"arcs = [60.0, {signed_arc}]\nangles = [90.0]\nsigned_arcs = true\n"
    unsigned_text = f"arcs = [60.0, 30.0]\nangles = [{angle}]\n"
    signed = loads(text.replace(coupler, signed_text))
    unsigned = loads(text.replace(coupler, unsigned_text))
    assert loads(dumps(signed)) == signed
    inputs = np.linspace(0.3, 6.0, 7)
    rotations = PositionAnalysis(signed).at(inputs).rotations
    expected = PositionAnalysis(unsigned).at(inputs).rotations
    assert np.allclose(rotations, expected, rtol=0.0, atol=1e-12)
