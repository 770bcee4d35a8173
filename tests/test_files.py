"""Faults in mechanism files: each names file, line, key, what is found and allowed."""

import os
from dataclasses import MISSING, fields

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


def fault(text):
    """Return the message with which a text is refused."""
    with pytest.raises(FileError) as caught:
        loads(text, "x.toml")
    return str(caught.value)


def test_the_files_these_faults_start_from_are_sound():
    mechanism = loads(SIZES)
    assert mechanism.links == ("1", "2", "3", "4")
    assert mechanism.geometry.zeros == {"21": 3.141592653589793}
    assert mechanism.inputs[0].start == 0.0 and mechanism.outputs[0].relative_to == "1"
    assert mechanism.user == {"note": "free"}
    cam = loads(POSE)
    assert cam.geometry.axes == {"a": (0.0, 0.0, 1.0), "b": (0.0, 1.0, 0.0)}
    assert cam.pairs[2].profiles[1].centre == (0.0, 0.0, 1.0)


def test_faults_are_listed_in_the_order_of_the_file():
    text = POSE.replace("xyz = [0.0, 0.0, 1.0]\nvalue = 10.0\n", "", 1)
    message = fault(text.replace("lonlat = [90.0, 0.0]\n", "", 1))
    assert message.startswith("x.toml:8: pairs.a: no geometry: give axes and arcs")

    text = replace_passages(SIZES, 'type = "R"', 'type = "X"')
    lines = fault(replace_passages(text, "[user]", "[users]")).split("\n")
    assert [line.split(": ")[0] for line in lines] == ["x.toml:22", "x.toml:44"]
    many = SIZES + "".join(f"[x{k}]\n" for k in range(20))
    assert fault(many).endswith("x.toml: and 12 more faults")


def test_windows_line_ends_and_user_data_are_kept():
    text = "\ufeff" + SIZES.replace("\n", "\r\n")
    assert loads(text) == loads(SIZES)
    assert fault(replace_passages(text, "70.5", "nan")).startswith("x.toml:16: ")

    text = SIZES + "x = nan\nangle_unit = 7\ntype.R = [1979-05-27, {a = 1.5}]\n"
    user = loads(text).user
    assert user["angle_unit"] == 7 and type(user["type"]["R"][1]["a"]) is float


def test_not_utf8(tmp_path):
    path = tmp_path / "x.toml"
    start = SIZES.encode()
    path.write_bytes(start + b'other = "\xff"\n')
    with pytest.raises(FileError) as caught:
        load(path)
    assert f"{path}:46: not UTF-8: byte 0xff at offset {len(start) + 9}" in str(
        caught.value
    )
    path.write_bytes(SIZES.encode("utf-16"))
    with pytest.raises(FileError, match="looks like UTF-16; save the file as UTF-8"):
        load(path)


def test_a_large_file_is_refused_by_its_size(tmp_path, monkeypatch):
    path = tmp_path / "large.toml"
    with path.open("wb") as stream:
        stream.truncate(50_000_000)
    monkeypatch.setattr("tomllib.loads", None)
    with pytest.raises(FileError, match=f"has 50000000 bytes; at most {MAX_BYTES}"):
        load(path)
    with pytest.raises(FileError, match="characters"):
        loads("#" * (MAX_BYTES + 1))


def test_folders_and_devices(tmp_path):
    with pytest.raises(FileError, match="is a folder"):
        load(tmp_path)
    if hasattr(os, "mkfifo"):
        os.mkfifo(tmp_path / "pipe.toml")
        with pytest.raises(FileError, match="not a regular file"):
            load(tmp_path / "pipe.toml")


def test_lines_of_all_kinds_of_keys():
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
    lines = locate_keys(text)
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
    assert {path: lines.get(path) for path in expected} == expected and ("x",) not in lines
    assert ("y",) not in lines


@pytest.mark.parametrize("kind", ["mechanism", "study", "synthesis"])
def test_every_key_of_the_schema_is_described(kind):
    waiting = [schema(kind)]
    while waiting:
        part = waiting.pop()
        for key, value in part.get("properties", {}).items():
            assert value.get("title"), key
            assert value.get("description", "").endswith("."), key
        if part.get("type") == "object" and "properties" in part:
            by_kind = list(part["properties"]) == ["kind"]
            assert part.get("additionalProperties", not by_kind) is False
        waiting.extend(part.get("$defs", {}).values())
    jsonschema.Draft202012Validator.check_schema(schema(kind))


def test_the_schema_agrees_with_the_code():
    parts = schema()["$defs"]
    assert parts["name"]["maxLength"] == MAX_NAME_LENGTH
    assert set(parts["pair"]["properties"]["type"]["enum"]) == {*JOINT_KINDS, "P"}
    assert parts["load"]["properties"]["kind"]["enum"] == [*LOADS]
    for kind, made in LOADS.items():
        part = parts[f"load_{kind}"]
        defaults = {each.name for each in fields(made) if each.default is not MISSING}
        assert set(part["properties"]) - {"kind"} == set(made.field_kinds)
        optional = defaults | set(made.defaults_in_files)
        assert set(part["required"]) - {"kind"} == set(made.field_kinds) - optional
    assert parts["expression"]["maxLength"] == MAX_LENGTH


@pytest.mark.parametrize("signed, turned", [(-30.0, 270.0), (330.0, 270.0), (-330.0, 90.0)])
def test_signed_arcs_lead_to_the_other_side(signed, turned):
    """Such an axis is where the shorter arc leads, turned by half a turn."""
    text = dumps(load("stephenson"))
    coupler = "arcs = [60.0, 30.0]\nangles = [90.0]\n"
    assert text.count(coupler) == 1
    found, plain = (
        loads(text.replace(coupler, f"arcs = [60.0, {arc}]\nangles = [{angle}]\n{key}"))
        for arc, angle, key in [(signed, 90.0, "signed_arcs = true\n"), (30.0, turned, "")]
    )
    assert loads(dumps(found)) == found
    q = np.linspace(0.3, 6.0, 7)
    one, other = (
        PositionAnalysis(mechanism).at(q).rotations for mechanism in (found, plain)
    )
    assert np.allclose(one, other, rtol=0.0, atol=1e-12)
