"""Files that ask for more than they should get, by name: text, bytes, or what is made."""

import math
import os

from refusals import text_of

FOUR_BAR = text_of("four_bar")
"""A valid mechanism, to which most of the files below add something."""

CAM = text_of("cam_hostile_files")
"""A mechanism whose last table, the cam's profile, is still to be filled."""

MILLION = 10**6


def texts():
    """Return the hostile texts of mechanism files, by name."""
    many = range(80000)
    load = '[loads.l]\npair = "a"\ntorque = '
    ring = "".join(f"[pairs.q{k}]\ntype='R'\nlinks=['1','2']\n" for k in many)
    rows = ", ".join(f"[{k}e-6,0,1]" for k in range(0, MILLION, 6))
    circle = [(2 * math.pi * k / 10000, 1 + 0.1 * math.cos(k / 800)) for k in range(9900)]
    points = ",".join(f"[{a:.9f},{b:.9f}]" for a, b in circle)
    return {
        "deep arrays": FOUR_BAR + "[user]\nx = " + "[" * MILLION,
        "deep closed arrays": FOUR_BAR + "[user]\nx = " + "[" * 90000 + "]" * 90000,
        "deep inline tables": FOUR_BAR + "[user]\nx = " + "{a=" * 90000 + "1" + "}" * 90000,
        "deep dotted key": FOUR_BAR + "[user]\n" + "a." * MILLION + "a = 1",
        "deep header": FOUR_BAR + "[user" + ".a" * MILLION + "]",
        "deep arrays of tables": FOUR_BAR
        + "".join(f"[[user{'.a' * k}]]\n" for k in range(1, 1000)),
        "integer of a million digits": FOUR_BAR + "from = " + "9" * MILLION,
        "hexadecimal of a million digits": FOUR_BAR + "from = 0x" + "f" * MILLION,
        "float of a million digits": FOUR_BAR + "from = 0." + "9" * MILLION,
        "small float of a million zeros": FOUR_BAR + "from = 0." + "0" * MILLION + "1",
        "huge exponent": FOUR_BAR + "from = 1e" + "9" * MILLION,
        "huge exponent in degrees": FOUR_BAR.replace('"rad"', '"deg"')
        + "from = 1e-99999999",
        "digits in degrees": FOUR_BAR.replace('"rad"', '"deg"')
        + "from = 0."
        + "9" * MILLION,
        "many pairs": FOUR_BAR + ring,
        "many links": FOUR_BAR + "".join(f"[links.q{k}]\n" for k in range(100000)),
        "many inputs": FOUR_BAR + "".join(f"[inputs.q{k}]\n" for k in many),
        "many outputs": FOUR_BAR + "".join(f"[outputs.q{k}]\nlink='2'\n" for k in many),
        "many loads": FOUR_BAR
        + "".join(f"[loads.q{k}]\npair='a'\ntorque='t'\n" for k in many),
        "many stops": FOUR_BAR
        + "".join(f"[joint_limits.q{k}]\nfrom=0\nto=1\n" for k in many),
        "many unknown keys": FOUR_BAR + "".join(f"q{k} = 1\n" for k in range(300000)),
        "many unknown tables": FOUR_BAR + "".join(f"[q{k}]\n" for k in range(300000)),
        "many faults": FOUR_BAR + "".join(f"[links.q{k}]\nx={k}\n" for k in range(100000)),
        "long name": FOUR_BAR.replace('"four_bar"', '"' + "a" * MILLION + '"'),
        "long key": FOUR_BAR + "a" * MILLION + " = 1",
        "long quoted key": FOUR_BAR + '"' + "\\u0041" * 500000 + '" = 1',
        "long string": FOUR_BAR + '[source]\ncitation = "' + "\\n" * MILLION + '"',
        "open string": FOUR_BAR + '[source]\ncitation = "' + "a" * MILLION,
        "open long string": FOUR_BAR + '[source]\ncitation = """' + '"a' * MILLION,
        "comments": FOUR_BAR + "#" * MILLION + "\n" + "#\n" * MILLION,
        "blank lines": FOUR_BAR + "\n" * 4 * MILLION,
        "long array": FOUR_BAR + "[user]\nx = [" + "1," * MILLION + "]",
        "long wrong array": FOUR_BAR + "from = [" + "1," * MILLION + "]",
        "long links": FOUR_BAR.replace('["1", "2"]', "[" + '"1",' * MILLION + "]"),
        "long arcs": FOUR_BAR.replace(
            "[links.1]", "[links.1]\narcs=[" + "1," * MILLION + "]"
        ),
        "parentheses": FOUR_BAR + load + "'" + "(" * 900 + "t" + ")" * 900 + "'",
        "many parentheses": FOUR_BAR + load + "'" + "(" * MILLION + "'",
        "signs": FOUR_BAR + load + "'" + "-" * 1900 + "t'",
        "powers": FOUR_BAR + load + "'9**9**9**9**9**9**9'",
        "a power of integers": FOUR_BAR + load + "'" + "9**" * 600 + "9'",
        "digits in an expression": FOUR_BAR + load + "'" + "9" * 1990 + "'",
        "nested functions": FOUR_BAR + load + "'" + "sin(" * 400 + "t" + ")" * 400 + "'",
        "many arguments": FOUR_BAR + load + "'max(" + "t," * 900 + "t)'",
        "profile of many points": CAM + "kind = 'points'\npoints_xyz = [" + rows + "]",
        "profile of the most points": CAM
        + f"kind = 'points'\nclosed = false\npoints = [{points}]",
        "profile of equal points": CAM
        + "kind = 'points'\npoints_xyz = ["
        + "[0,0,1]," * 400000
        + "]",
        "profile of a long series": CAM
        + "kind = 'fourier'\ncentre_xyz = [0,0,1]\ncosines = [0.5, "
        + "1e-9," * 500000
        + "]",
        "profile of a high series": CAM
        + "kind = 'fourier'\ncentre_xyz = [0,0,1]\ncosines = [0.5, "
        + "0.0," * 9000
        + "1e-6]",
        "long table of a load": FOUR_BAR
        + "[loads.l]\nkind='table'\npair='a'\ntimes=["
        + ",".join(map(str, range(300000)))
        + "]\ntorques=["
        + "1," * 300000
        + "]",
        "a name of a device": FOUR_BAR.replace("four_bar", "../../../dev/null"),
        "a name with a slash": FOUR_BAR.replace("four_bar", "a/b"),
        "a name with NUL": FOUR_BAR.replace("four_bar", "a\\u0000b"),
        "a name with a dash": FOUR_BAR.replace("four_bar", "-rf"),
        "an empty name": FOUR_BAR.replace("four_bar", ""),
        "a name with a line end": FOUR_BAR.replace("four_bar", "four_bar\\n"),
        "a right-to-left name": FOUR_BAR.replace("four_bar", "a\\u202eb"),
        "an escape sequence": FOUR_BAR.replace("four_bar", "a\\u001b[31mb"),
        "an escape sequence as key": FOUR_BAR + '"\\u001b[31m" = 1',
        "a surrogate": FOUR_BAR.replace("four_bar", "\\ud800"),
    }


def make_files(folder):
    """Make the hostile files that are not texts, and return their paths by name."""
    paths = {name: folder / name for name in ("loop", "pipe", "sparse", "folder")}
    paths["loop"].symlink_to(folder / "loop")
    os.mkfifo(paths["pipe"])
    with paths["sparse"].open("wb") as stream:
        stream.truncate(100 * MILLION)
    paths["folder"].mkdir()
    paths["bytes"] = folder / "bytes"
    paths["bytes"].write_bytes(bytes(range(256)) * 1000)
    paths["zeros"] = folder / "zeros"
    paths["zeros"].write_bytes(bytes(1000))
    paths["missing"] = folder / ("a" * 5000)
    paths["NUL"] = folder / "a\0b"
    paths["below a file"] = paths["zeros"] / "x"
    return {name: str(path) for name, path in paths.items()} | {
        "/dev/zero": "/dev/zero",
        "/dev/stdin": "/dev/stdin",
        "/proc/self/mem": "/proc/self/mem",
    }


STUDY = """\
format = 1
mechanism = "four_bar"
angle_unit = "rad"
"""


def studies():
    """Return the hostile texts of study files, by name."""
    named = STUDY.replace("four_bar", "{}").format
    return {
        "mechanism outside": named("../../../../../../etc/passwd"),
        "mechanism a device": named("/dev/zero"),
        "mechanism a folder": named("."),
        "mechanism itself": named("hostile.study.toml"),
        "mechanism with NUL": named("a\\u0000b"),
        "mechanism of a long name": named("a" * 4000),
        "mechanism of nothing": named(""),
        "folder with NUL": STUDY + '[output]\nfolder = "a\\u0000b"',
        "folder with an escape": STUDY + '[output]\nfolder = "a\\u001b[2Jb"',
        "many values": STUDY + "[inputs.21]\nvalues = [" + "1," * MILLION + "]",
        "the most values": STUDY + "[inputs.21]\nvalues = [" + "1.5," * 190000 + "]",
        "a grid of grids": STUDY + "samples = [" + "1," * MILLION + "]",
        "negative samples": STUDY + "samples = -1",
        "many analyses": STUDY + "".join(f"[analyses.q{k}]\n" for k in range(40000)),
        "many parameters": STUDY
        + "[analyses.poles]\n"
        + "".join(f"q{k} = {k}\n" for k in range(40000)),
        "long table of a law": STUDY
        + "[inputs.21.law]\nkind='table'\ntimes=["
        + ",".join(map(str, range(90000)))
        + "]\nangles=["
        + "1," * 90000
        + "]",
        "coefficients": STUDY
        + "duration=1.0\n[inputs.21.law]\nkind='polynomial'\ncoefficients=["
        + "1," * 200000
        + "]",
    }
