"""Files that could make a program read too much, wait for ever, or leave its folder."""

import math
import os

from helpers.refusals import mechanism_text

FOUR_BAR = mechanism_text("four_bar")
"""A valid mechanism, to which most of the files below add something."""

CAM = mechanism_text("cam_hostile_files")
"""A mechanism whose last table, the profile of the cam, is empty. Entries are appended."""

MILLION = 10**6


def hostile_mechanism_texts():
    """Return the hostile texts of mechanism files, by name."""
    many = range(80000)
    load = '[loads.l]\npair = "a"\ntorque = '
    ring = "".join(f"[pairs.q{k}]\ntype='R'\nlinks=['1','2']\n" for k in many)
    rows = ", ".join(f"[{k}e-6,0,1]" for k in range(0, MILLION, 6))
    circle = [(2 * math.pi * k / 10000, 1 + 0.1 * math.cos(k / 800)) for k in range(9900)]
    points = ",".join(f"[{a:.9f},{b:.9f}]" for a, b in circle)
    series = "kind = 'fourier'\ncentre_xyz = [0,0,1]\ncosines = [0.5, "
    through = "kind = 'points'\npoints_xyz = ["
    added = {
        "deep arrays": "[user]\nx = " + "[" * MILLION,
        "deep closed arrays": "[user]\nx = " + "[" * 90000 + "]" * 90000,
        "deep inline tables": "[user]\nx = " + "{a=" * 90000 + "1" + "}" * 90000,
        "deep dotted key": "[user]\n" + "a." * MILLION + "a = 1",
        "deep header": "[user" + ".a" * MILLION + "]",
        "deep arrays of tables": "".join(f"[[user{'.a' * k}]]\n" for k in range(1, 1000)),
        "integer of a million digits": "from = " + "9" * MILLION,
        "hexadecimal of a million digits": "from = 0x" + "f" * MILLION,
        "float of a million digits": "from = 0." + "9" * MILLION,
        "small float of a million zeros": "from = 0." + "0" * MILLION + "1",
        "huge exponent": "from = 1e" + "9" * MILLION,
        "many pairs": ring,
        "many links": "".join(f"[links.q{k}]\n" for k in range(100000)),
        "many inputs": "".join(f"[inputs.q{k}]\n" for k in many),
        "many outputs": "".join(f"[outputs.q{k}]\nlink='2'\n" for k in many),
        "many loads": "".join(f"[loads.q{k}]\npair='a'\ntorque='t'\n" for k in many),
        "many stops": "".join(f"[joint_limits.q{k}]\nfrom=0\nto=1\n" for k in many),
        "many unknown keys": "".join(f"q{k} = 1\n" for k in range(300000)),
        "many unknown tables": "".join(f"[q{k}]\n" for k in range(300000)),
        "many faults": "".join(f"[links.q{k}]\nx={k}\n" for k in range(100000)),
        "long key": "a" * MILLION + " = 1",
        "long quoted key": '"' + "\\u0041" * 500000 + '" = 1',
        "long string": '[source]\ncitation = "' + "\\n" * MILLION + '"',
        "open string": '[source]\ncitation = "' + "a" * MILLION,
        "open long string": '[source]\ncitation = """' + '"a' * MILLION,
        "comments": "#" * MILLION + "\n" + "#\n" * MILLION,
        "blank lines": "\n" * 4 * MILLION,
        "long array": "[user]\nx = [" + "1," * MILLION + "]",
        "long wrong array": "from = [" + "1," * MILLION + "]",
        "parentheses": load + "'" + "(" * 900 + "t" + ")" * 900 + "'",
        "many parentheses": load + "'" + "(" * MILLION + "'",
        "signs": load + "'" + "-" * 1900 + "t'",
        "powers": load + "'9**9**9**9**9**9**9'",
        "a power of integers": load + "'" + "9**" * 600 + "9'",
        "digits in an expression": load + "'" + "9" * 1990 + "'",
        "nested functions": load + "'" + "sin(" * 400 + "t" + ")" * 400 + "'",
        "many arguments": load + "'max(" + "t," * 900 + "t)'",
        "long table of a load": "[loads.l]\nkind='table'\npair='a'\ntimes=["
        + f"{','.join(map(str, range(300000)))}]\ntorques=[{'1,' * 300000}]",
        "an escape sequence as key": '"\\u001b[31m" = 1',
    }
    profiles = {
        "profile of many points": through + rows + "]",
        "profile of the most points": f"kind='points'\nclosed=false\npoints=[{points}]",
        "profile of equal points": through + "[0,0,1]," * 400000 + "]",
        "profile of a long series": series + "1e-9," * 500000 + "]",
        "profile of a high series": series + "0.0," * 9000 + "1e-6]",
    }
    named = {
        "a name of a device": "../../../dev/null",
        "a name with a slash": "a/b",
        "a name with NUL": "a\\u0000b",
        "a name with a dash": "-rf",
        "an empty name": "",
        "a name with a line end": "four_bar\\n",
        "a right-to-left name": "a\\u202eb",
        "an escape sequence": "a\\u001b[31mb",
        "a surrogate": "\\ud800",
    }
    return {
        **{name: FOUR_BAR + text for name, text in added.items()},
        **{name: CAM + text for name, text in profiles.items()},
        **{name: FOUR_BAR.replace("four_bar", text) for name, text in named.items()},
        "huge exponent in degrees": FOUR_BAR.replace('"rad"', '"deg"')
        + "from = 1e-99999999",
        "digits in degrees": FOUR_BAR.replace('"rad"', '"deg"')
        + "from = 0."
        + "9" * MILLION,
        "long name": FOUR_BAR.replace('"four_bar"', '"' + "a" * MILLION + '"'),
        "long links": FOUR_BAR.replace('["1", "2"]', "[" + '"1",' * MILLION + "]"),
        "long arcs": FOUR_BAR.replace(
            "[links.1]", "[links.1]\narcs=[" + "1," * MILLION + "]"
        ),
    }


def make_files(folder):
    """Create hostile files in a folder, and return their paths as texts by name.

    They could make a program read without end, or wait for ever: a link to itself, a pipe
    to which nobody writes, a sparse file of 100 MB, bytes that are no text, names that no
    file can have, and devices.
    """
    link_to_itself = folder / "loop"
    link_to_itself.symlink_to(link_to_itself)
    pipe = folder / "pipe"
    os.mkfifo(pipe)
    sparse = folder / "sparse"
    with sparse.open("wb") as stream:
        stream.truncate(100 * MILLION)
    empty_folder = folder / "folder"
    empty_folder.mkdir()
    all_bytes = folder / "bytes"
    all_bytes.write_bytes(bytes(range(256)) * 1000)
    zeros = folder / "zeros"
    zeros.write_bytes(bytes(1000))
    return {
        "loop": str(link_to_itself),
        "pipe": str(pipe),
        "sparse": str(sparse),
        "folder": str(empty_folder),
        "bytes": str(all_bytes),
        "zeros": str(zeros),
        "missing": str(folder / ("a" * 5000)),
        "NUL": str(folder / "a\0b"),
        "below a file": str(zeros / "x"),
        "/dev/zero": "/dev/zero",
        "/dev/stdin": "/dev/stdin",
        "/proc/self/mem": "/proc/self/mem",
    }


STUDY = """\
format = 1
mechanism = "four_bar"
angle_unit = "rad"
"""


def hostile_study_texts():
    """Return hostile texts of study files by name, which must be refused or read quickly.

    They name mechanisms outside of the folder or of no file, ask for millions of samples,
    or have tables of tens of thousands of entries.
    """

    def with_mechanism(name):
        return STUDY.replace("four_bar", name)

    parameters = "".join(f"q{k} = {k}\n" for k in range(40000))
    law = STUDY + "[inputs.21.law]\n"
    times = ",".join(map(str, range(90000)))
    return {
        "mechanism outside": with_mechanism("../../../../../../etc/passwd"),
        "mechanism a device": with_mechanism("/dev/zero"),
        "mechanism a folder": with_mechanism("."),
        # The test saves the text under this name, so the study names itself.
        "mechanism itself": with_mechanism("hostile.study.toml"),
        "mechanism with NUL": with_mechanism("a\\u0000b"),
        "mechanism of a long name": with_mechanism("a" * 4000),
        "mechanism of nothing": with_mechanism(""),
        "folder with NUL": STUDY + '[output]\nfolder = "a\\u0000b"',
        "folder with an escape": STUDY + '[output]\nfolder = "a\\u001b[2Jb"',
        "many values": STUDY + "[inputs.21]\nvalues = [" + "1," * MILLION + "]",
        # A file may have 200000 values.
        "the most values": STUDY + "[inputs.21]\nvalues = [" + "1.5," * 190000 + "]",
        "a grid over a million inputs": STUDY + "samples = [" + "1," * MILLION + "]",
        "negative samples": STUDY + "samples = -1",
        "many analyses": STUDY + "".join(f"[analyses.q{k}]\n" for k in range(40000)),
        "many parameters": STUDY + f"[analyses.poles]\n{parameters}",
        "long table of a law": law
        + f"kind='table'\ntimes=[{times}]\nangles=[{'1,' * 90000}]",
        "coefficients": f"{STUDY}duration=1.0\n[inputs.21.law]\nkind='polynomial'\n"
        + f"coefficients=[{'1,' * 200000}]",
    }
