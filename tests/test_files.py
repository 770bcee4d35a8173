"""Faults in mechanism files: each names file, line, key, what is found and allowed."""

import json
import os
import subprocess
import sys
from contextlib import suppress
from dataclasses import MISSING, fields

import numpy as np
import pytest

from spherekit.conventions import MAX_NAME_LENGTH
from spherekit.errors import FileError
from spherekit.files.document import MAX_BYTES, locate
from spherekit.files.read import load, loads
from spherekit.files.schema import schema
from spherekit.files.write import dumps
from spherekit.model.dynamics import LOADS
from spherekit.model.expression import MAX_LENGTH
from spherekit.model.joints import KINDS
from spherekit.motion.motion import Tracer

SIZES = """\
format = 1
name = "four_bar"
angle_unit = "deg"
ground = "1"

[links.1]
axes = ["41", "21"]
arcs = [60.0]
[links.2]
axes = ["21", "32"]
arcs = [
    30.0,
]
[links.3]
axes = ["32", "43"]
arcs = [70.5]
[links.4]
axes = ["43", "41"]
arcs = [50]

[pairs.21]
type = "R"
links = ["1", "2"]
zero = 180.0
[pairs.32]
type = "R"
links = ["2", "3"]
[pairs.43]
type = "R"
links = ["3", "4"]
[pairs.41]
type = "R"
links = ["1", "4"]

[inputs.21]
to = 90.0
[outputs.rocker]
link = "4"
[mass.2]
tensor = [[2, 0, 0], [0, 1.92, -0.3], [0, -0.3, 0.08]]
[loads.friction]
pair = "21"
torque = "-sin(theta_21) - 2*dtheta_21"
[user]
note = "free"
"""

POSE = """\
format = 1
name = "cam"
angle_unit = "deg"
ground = "1"
[links.1]
[links.2]
[links.3]
[pairs.a]
type = "R"
links = ["1", "2"]
xyz = [0.0, 0.0, 1.0]
value = 10.0
[pairs.b]
type = "R"
links = ["1", "3"]
lonlat = [90.0, 0.0]
[pairs.c]
type = "Cs"
links = ["2", "3"]
[pairs.c.profiles.2]
kind = "fourier"
centre_xyz = [0.0, 0.0, 1.0]
cosines = [40.0, 5.0]
[pairs.c.profiles.3]
kind = "circle"
centre_lonlat = [0.0, 90.0]
radius = 20.0
"""


def fault(text):
    """Return the message with which a text is refused."""
    with pytest.raises(FileError) as caught:
        loads(text, "x.toml")
    return str(caught.value)


def changed(text, old, new):
    """Return the text with one passage replaced."""
    assert text.count(old) >= 1
    return text.replace(old, new, 1)


def test_the_files_these_faults_start_from_are_sound():
    mechanism = loads(SIZES)
    assert mechanism.links == ("1", "2", "3", "4")
    assert mechanism.geometry.zeros == {"21": 3.141592653589793}
    assert mechanism.inputs[0].start == 0.0
    assert mechanism.outputs[0].relative_to == "1"
    assert mechanism.user == {"note": "free"}
    cam = loads(POSE)
    assert cam.geometry.axes == {"a": (0.0, 0.0, 1.0), "b": (0.0, 1.0, 0.0)}
    assert cam.pairs[2].profiles[1].centre == (0.0, 0.0, 1.0)


FAULTS = {
    # case: (base, old, new, line and key, words that must occur)
    "unknown key at the top": (
        SIZES,
        'ground = "1"',
        'ground = "1"\ngruond = "1"',
        "5: gruond: unknown key",
        ['did you mean "ground"?', "allowed at the top of the file: format, name"],
    ),
    "unknown key in a link": (
        SIZES,
        "arcs = [60.0]",
        "arc = [60.0]",
        "8: links.1.arc: unknown key",
        ['did you mean "arcs"?', "allowed in links.1: axes, arcs, angles"],
    ),
    "unknown key in a pair": (
        SIZES,
        "zero = 180.0",
        "zeros = 180.0",
        "24: pairs.21.zeros: unknown key",
        ['did you mean "zero"?'],
    ),
    "no angle unit": (
        SIZES,
        'angle_unit = "deg"\n',
        "",
        "1: the key angle_unit is missing",
        ['no default: "deg" or "rad"'],
    ),
    "wrong angle unit": (
        SIZES,
        '"deg"',
        '"degree"',
        '3: angle_unit: found "degree", allowed: deg, rad',
        ['did you mean "deg"?'],
    ),
    "missing key": (
        SIZES,
        'link = "4"\n',
        "",
        "37: outputs.rocker: the key link is missing",
        ["the link that moves"],
    ),
    "no format": (SIZES, "format = 1\n", "", "1: format: missing", ["format = 1"]),
    "newer format": (
        SIZES,
        "format = 1",
        "format = 2",
        "1: format: found 2",
        ["this version of spherekit reads 1", "needs a newer spherekit"],
    ),
    "format zero": (
        SIZES,
        "format = 1",
        "format = 0",
        "1: format: found 0",
        ["needs 1"],
    ),
    "format true": (SIZES, "format = 1", "format = true", "1: format: found true", []),
    "two geometries, axis": (
        SIZES,
        "zero = 180.0",
        "xyz = [0, 0, 1]",
        "24: pairs.21.xyz: two geometries",
        ["links.1.axes (line 7)"],
    ),
    "two geometries, arcs": (
        POSE,
        "[links.2]",
        "[links.2]\narcs = [1.0]",
        "12: pairs.a.xyz: two geometries",
        ["links.2.arcs (line 7)"],
    ),
    "repeated table": (
        SIZES,
        "[links.2]",
        "[links.1]",
        "9: links.1: is given twice, first on line 6",
        ["names are unique", "Cannot declare"],
    ),
    "repeated key": (
        SIZES,
        "arcs = [60.0]",
        "arcs = [60.0]\narcs = [6.0]",
        "9: arcs: this key is given twice",
        ["keys are unique"],
    ),
    "absent link": (
        SIZES,
        'links = ["1", "2"]',
        'links = ["1", "22"]',
        '23: pairs.21.links: no link is named "22"',
        ['did you mean "2"?', "Links: 1, 2, 3, 4"],
    ),
    "pair on one link": (
        SIZES,
        'links = ["1", "2"]',
        'links = ["1", "1"]',
        "21: pairs.21: joins link",
        [],
    ),
    "absent ground": (SIZES, 'ground = "1"', 'ground = "9"', "4: ground: no link", []),
    "absent input": (
        SIZES,
        "[inputs.21]",
        "[inputs.22]",
        '35: inputs.22: no pair is named "22"',
        ["Pairs: 21, 32, 43, 41"],
    ),
    "absent link with mass": (SIZES, "[mass.2]", "[mass.9]", "39: mass.9: no link", []),
    "absent loaded pair": (
        SIZES,
        'pair = "21"',
        'pair = "12"',
        '42: loads.friction.pair: no pair is named "12"',
        [],
    ),
    "pair type": (
        SIZES,
        'type = "R"',
        'type = "r"',
        '22: pairs.21.type: found "r", allowed: R, P, Cr, Cs',
        ['did you mean "R"?'],
    ),
    "no first digit": (SIZES, "70.5", ".5", "16: column 9:", ["write 0.5, not .5"]),
    "no last digit": (
        SIZES,
        "180.0",
        "5.",
        "24: column 9:",
        ["write 5.0 or 5, not 5."],
    ),
    "no last digit in array": (SIZES, "70.5", "5.", "16: ", ["write 5.0 or 5, not 5."]),
    "no quotes": (SIZES, '= "R"', "= R", "22: column 8:", ['write "R", not R']),
    "capital true": (SIZES, '"free"', "True", "45: ", ["small letters"]),
    "unfinished": (SIZES, 'note = "free"', 'note = "', "45: ", ["Illegal character"]),
    "zero vector": (
        POSE,
        "[0.0, 0.0, 1.0]",
        "[0, 0, 0]",
        "11: pairs.a.xyz: the zero vector has no direction",
        ["give the axis as [x, y, z]"],
    ),
    "not a unit vector": (
        POSE,
        "[0.0, 0.0, 1.0]",
        "[0, 3, 4]",
        "11: pairs.a.xyz: found length 5, needs a unit vector",
        ["did you mean [0.0, 0.6, 0.8]?"],
    ),
    "latitude": (
        POSE,
        "[90.0, 0.0]",
        "[0, 91]",
        "16: pairs.b.lonlat: the latitude",
        [],
    ),
    "nan": (SIZES, "70.5", "nan", "16: links.3.arcs[0]: found nan", ["finite"]),
    "infinite": (
        SIZES,
        "1.92",
        "-inf",
        "40: mass.2.tensor[1][1]: found -inf",
        ["finite"],
    ),
    "bool for a number": (
        SIZES,
        "180.0",
        "true",
        "24: pairs.21.zero: found true (true or false), needs a number",
        [],
    ),
    "text for a number": (
        SIZES,
        "70.5",
        '"a"',
        '16: links.3.arcs[0]: found "a" (text)',
        [],
    ),
    "number for text": (
        SIZES,
        '= "1"',
        "= 1",
        "4: ground: found 1 (number), needs text",
        [],
    ),
    "number for a torque": (
        SIZES,
        'torque = "-sin(theta_21) - 2*dtheta_21"',
        "torque = 5",
        "43: loads.friction.torque: found 5 (number), needs text in quotes",
        [],
    ),
    "huge integer": (SIZES, "180.0", "9" * 400, "24: pairs.21.zero: found a huge", []),
    "endless integer": (SIZES, "180.0", "9" * 9999, "24: ", ["too many digits"]),
    "endless hexadecimal": (
        SIZES,
        "180.0",
        "0x" + "9" * 9999,
        "24: pairs.21.zero: ",
        [],
    ),
    "large angle": (SIZES, "180.0", "1e300", "24: pairs.21.zero: ", ["at most 1e+06"]),
    "wrong length": (
        SIZES,
        "arcs = [70.5]",
        "arcs = [70.5, 3]",
        "16: links.3.arcs: has 2 values, needs 1",
        [],
    ),
    "wrong length over lines": (
        SIZES,
        "    30.0,\n",
        "",
        "11: links.2.arcs: has 0",
        [],
    ),
    "vector of two": (
        POSE,
        "xyz = [0.0, 0.0, 1.0]",
        "xyz = [0.0, 1.0]",
        "11: pairs.a.xyz: has 2 values, needs 3",
        [],
    ),
    "one link": (
        SIZES,
        'links = ["1", "2"]',
        'links = ["1"]',
        "23: pairs.21.links: ",
        [],
    ),
    "axis twice": (
        SIZES,
        '["41", "21"]',
        '["41", "41"]',
        "7: links.1.axes: ",
        ["twice"],
    ),
    "axes differ": (
        SIZES,
        '["41", "21"]',
        '["41", "2"]',
        "7: links.1.axes: has [41, 2]",
        [],
    ),
    "degrees in a rad file": (
        SIZES,
        '"deg"',
        '"rad"',
        "8: links.1.arcs[0]: found 60.0 rad",
        ["looks like degrees", 'angle_unit = "deg"'],
    ),
    "negative arc": (
        SIZES,
        "70.5",
        "-70.5",
        "16: links.3.arcs[0]: found -70.5 deg",
        ["between 0 and 180 deg", "an axis 70.5 deg away", "signed_arcs = true"],
    ),
    "arc beyond half a turn": (
        SIZES,
        "70.5",
        "289.5",
        "16: links.3.arcs[0]: found 289.5 deg",
        ["an axis 70.5 deg away", "signed_arcs = true"],
    ),
    "signed arcs, not a boolean": (
        SIZES,
        "arcs = [70.5]",
        "arcs = [70.5]\nsigned_arcs = 1",
        "17: links.3.signed_arcs: found 1 (number), needs true or false",
        [],
    ),
    "path in the name": (
        SIZES,
        '"four_bar"',
        '"../../secret"',
        '2: name: found "../../secret"; use 1 to 64 letters',
        [],
    ),
    "newline in the name": (SIZES, '"four_bar"', '"four_bar\\n"', "2: name: found", []),
    "empty name": (SIZES, '"four_bar"', '""', "2: name: found", []),
    "path in a table name": (
        SIZES,
        "[outputs.rocker]",
        '[outputs."a/../b"]',
        "37: outputs.'a/../b': the name \"a/../b\" is not allowed",
        ["letters (A-Z, a-z), digits and underscores"],
    ),
    "long name": (SIZES, "rocker", "r" * 65, "37: outputs.", ["use 1 to 64 letters"]),
    "deep arrays": (SIZES, '"free"', "[" * 900 + "]" * 900, "45: nested too", ["32"]),
    "deepish arrays": (
        SIZES,
        '"free"',
        "[" * 50 + "]" * 50,
        "45: user.note[0]: nested",
        [],
    ),
    "deep keys": (SIZES, "note", ".".join("n" * 90), "45: a key has over 32", []),
    "not symmetric": (
        SIZES,
        "-0.3, 0.08",
        "-0.31, 0.08",
        "40: mass.2.tensor: not symmetric: row 2, column 3 has -0.3",
        ["row 3, column 2 has -0.31"],
    ),
    "hostile torque": (
        SIZES,
        "-sin(theta_21)",
        "__import__('os').system('true')",
        "43: loads.friction.torque: in the expression, column 12: found",
        [],
    ),
    "misspelt torque": (
        SIZES,
        "-sin(theta_21)",
        "-sin(thet_21)",
        '43: loads.friction.torque: in the expression, column 6: "thet_21" is not',
        ['did you mean "theta_21"?'],
    ),
    "table for an array": (
        SIZES,
        "[mass.2]",
        "[[mass]]",
        "39: mass: found",
        ["a table"],
    ),
    "both directions": (
        POSE,
        "value = 10.0",
        "lonlat = [0, 90]",
        "12: pairs.a.lonlat: xyz is given already",
        [],
    ),
    "profiles on R": (
        POSE,
        'type = "Cs"',
        'type = "R"',
        "20: pairs.c.profiles: only contact pairs",
        [],
    ),
    "axis on a contact": (
        POSE,
        'type = "R"',
        'type = "Cr"',
        "11: pairs.a.xyz: only R",
        [],
    ),
    "no radius": (
        POSE,
        "radius = 20.0\n",
        "",
        "24: pairs.c.profiles.3: the key radius",
        [],
    ),
    "no centre": (
        POSE,
        "centre_lonlat = [0.0, 90.0]\n",
        "",
        "24: pairs.c.profiles.3: a circle needs its centre",
        ["centre_xyz"],
    ),
    "foreign profile key": (
        POSE,
        "radius = 20.0",
        "radius = 20.0\nclosed = false",
        "28: pairs.c.profiles.3.closed: a profile of kind circle has no such key",
        [],
    ),
    "foreign profile": (
        POSE,
        "profiles.3]",
        "profiles.1]",
        '24: pairs.c.profiles.1: the pair joins "2" and "3", not "1"',
        [],
    ),
    "no axis": (
        POSE,
        "lonlat = [90.0, 0.0]\n",
        "",
        "13: pairs.b: its axis in the reference pose is missing",
        [],
    ),
}


@pytest.mark.parametrize("case", FAULTS)
def test_faults_name_line_key_and_remedy(case):
    base, old, new, start, words = FAULTS[case]
    message = fault(changed(base, old, new))
    assert f"x.toml:{start}" in message
    for word in words:
        assert word in message


def test_no_geometry_at_all():
    text = POSE.replace("xyz = [0.0, 0.0, 1.0]\nvalue = 10.0\n", "", 1)
    message = fault(text.replace("lonlat = [90.0, 0.0]\n", "", 1))
    assert message.startswith("x.toml:8: pairs.a: no geometry: give axes and arcs")


def test_all_faults_are_listed_in_the_order_of_the_file():
    text = changed(SIZES, 'type = "R"', 'type = "X"')
    lines = fault(changed(text, "[user]", "[users]")).split("\n")
    assert [line.split(": ")[0] for line in lines] == ["x.toml:22", "x.toml:44"]
    many = SIZES + "".join(f"[x{k}]\n" for k in range(20))
    assert fault(many).endswith("x.toml: and 12 more faults")


def test_damaged_files_are_file_errors_or_mechanisms():
    random = np.random.default_rng(11)
    words = [*"[]{}\"'.=,\n#\\-_05e\x00é", *SIZES.split(), *POSE.split()]
    for _ in range(800):
        text = (SIZES, POSE)[random.integers(2)]
        for _ in range(random.integers(1, 4)):
            start = int(random.integers(len(text)))
            stop = start + int(random.integers(4))
            text = text[:start] + words[random.integers(len(words))] + text[stop:]
        with suppress(FileError):
            loads(text)


def test_windows_line_ends_and_byte_order_mark():
    text = "\ufeff" + SIZES.replace("\n", "\r\n")
    assert loads(text) == loads(SIZES)
    assert fault(changed(text, "70.5", "nan")).startswith("x.toml:16: ")


def test_user_data_is_kept_and_never_interpreted():
    text = SIZES + "x = nan\nangle_unit = 7\ntype.R = [1979-05-27, {a = 1.5}]\n"
    user = loads(text).user
    assert user["angle_unit"] == 7
    assert type(user["type"]["R"][1]["a"]) is float


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
    lines = locate(text)
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
    assert {path: lines.get(path) for path in expected} == expected
    assert ("x",) not in lines
    assert ("y",) not in lines


def test_every_key_of_the_schema_is_described():
    waiting, keys = [schema()], 0
    while waiting:
        part = waiting.pop()
        for key, value in part.get("properties", {}).items():
            assert value.get("title"), key
            assert value.get("description", "").endswith("."), key
            keys += 1
        if part.get("type") == "object" and "properties" in part:
            by_kind = list(part["properties"]) == ["kind"]
            assert part.get("additionalProperties", not by_kind) is False
        waiting.extend(part.get("$defs", {}).values())
    assert keys >= 40


def test_the_schema_agrees_with_the_code():
    parts = schema()["$defs"]
    assert parts["name"]["maxLength"] == MAX_NAME_LENGTH
    assert set(parts["pair"]["properties"]["type"]["enum"]) == {*KINDS, "P"}
    assert parts["load"]["properties"]["kind"]["enum"] == [*LOADS]
    for kind, made in LOADS.items():
        part = parts[f"load_{kind}"]
        defaults = {each.name for each in fields(made) if each.default is not MISSING}
        assert set(part["properties"]) - {"kind"} == set(made.keys)
        optional = defaults | set(made.absent)
        assert set(part["required"]) - {"kind"} == set(made.keys) - optional
    assert parts["expression"]["maxLength"] == MAX_LENGTH
    jsonschema = pytest.importorskip("jsonschema")
    jsonschema.Draft202012Validator.check_schema(schema())


def test_reading_imports_little():
    code = (
        "import sys, json, spherekit.files.read; "
        "print(json.dumps(sorted({name.split('.')[0] for name in sys.modules})))"
    )
    out = subprocess.run([sys.executable, "-c", code], capture_output=True, check=True)
    loaded = set(json.loads(out.stdout)) - set(sys.stdlib_module_names)
    assert not loaded & {"jsonschema", "tomli_w", "networkx", "scipy", "pandas"}


@pytest.mark.parametrize("signed, turned", [(-30.0, 270.0), (330.0, 270.0), (-330.0, 90.0)])
def test_signed_arcs_lead_to_the_other_side(signed, turned):
    """Such an axis is where the shorter arc leads, turned by half a turn."""
    text = dumps(load("stephenson"))
    coupler = "arcs = [60.0, 30.0]\nangles = [90.0]\n"
    assert text.count(coupler) == 1
    found, plain = (
        loads(text.replace(coupler, f"arcs = [60.0, {arc}]\nangles = [{angle}]\n{key}"))
        for arc, angle, key in [
            (signed, 90.0, "signed_arcs = true\n"),
            (30.0, turned, ""),
        ]
    )
    assert loads(dumps(found)) == found
    q = np.linspace(0.3, 6.0, 7)
    one, other = (Tracer(mechanism).at(q).rotations for mechanism in (found, plain))
    assert np.allclose(one, other, rtol=0.0, atol=1e-12)
