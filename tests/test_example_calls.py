"""The example calls in exported C: compiled as they stand, against `sk.evaluate`."""

import re
import subprocess

import numpy as np
import pytest
from helpers.exported_languages import GCC

import spherekit as sk

pytestmark = pytest.mark.skipif(not GCC, reason="no C compiler")

FLAGS = ["-std=c99", "-Wall", "-Wextra", "-pedantic", "-Werror"]


def example_in(text):
    """Return the example call, which is indented by seven spaces in a comment."""
    return re.search(r"Example: .*?\n\n((?: {7}.*\n)+)\*/", text)[1]


def run_program(folder, head, body, sources=()):
    """Compile a C program that calls an exported source, and return the number it prints.

    Parameters
    ----------
    folder
        Folder of the sources.
    head, body
        Text before the function ``main``, and its statements.
    sources
        Names of further source files in the folder.
    """
    text = f"#include <stdio.h>\n{head}\nint main(void)\n{{\n{body}    return 0;\n}}\n"
    (folder / "main.c").write_text(text, encoding="ascii")
    files = ["main.c", *sources]
    command = [GCC, *FLAGS, "-o", "main", *files, "-lm"]
    subprocess.run(command, cwd=folder, check=True, capture_output=True, timeout=60)
    finished = subprocess.run(
        [folder / "main"], check=True, capture_output=True, text=True, timeout=60
    )
    return float(finished.stdout)


def prototypes_after(text, example):
    """Return the declarations that a C program needs to call an exported function.

    An exported source contains a comment that ends with an example call. The comment tells
    the user to copy the declarations below it to the program that calls the function. After
    the end of the comment, ``*/``, there are

    - prototypes such as ``void four_bar(const double motion[], ...);``, up to an empty
      line;
    - the names of results, ``enum { four_bar_theta_32 = 0, ... };``.

    Parameters
    ----------
    text
        Text of the exported source.
    example
        The example call, which `example_in` finds in this text.
    """
    # This text begins with the end of the comment.
    after_example = text.partition(example)[2]
    parts = re.match(r"\*/\n(.*?\n)\n(enum \{.*?\};)", after_example, re.S)
    prototypes = parts[1]
    names_of_results = parts[2]
    return prototypes + names_of_results


def inputs_of_example(example, count):
    """Return the first numbers of ``motion[...] = {...}``: the inputs (rad)."""
    numbers = re.search(r"motion\[\d+\] = \{(.*?)\}", example)[1].split(",")
    return [float(number) for number in numbers[:count]]


def pair_of_example(example, name):
    """Return the pair whose angle the example prints, as ``result[NAME_theta_PAIR]``."""
    return re.search(rf"result\[{name}_theta_(\w+)\]", example)[1]


@pytest.mark.parametrize(
    ("name", "options"),
    [
        ("four_bar", {}),
        ("four_bar", {"vary": ["links.2.arc"]}),
        ("flat_foldable_vertex", {}),
        ("five_bar", {}),
        pytest.param("double_butterfly", {}, marks=pytest.mark.slow),
    ],
)
def test_the_example_call_of_c_gives_the_first_variable(name, options, tmp_path):
    """The example call in an exported C source works if it is copied to a new file.

    The source tells the user to copy the declarations of its functions and results too.
    `prototypes_after` reads them. The example is in assembly mode 0 at the inputs that it
    states. It prints the first result, the angle of a pair. This angle must be that of
    `sk.evaluate`, but for whole turns.
    """
    sk.export(name, tmp_path / "source.c", **options)
    text = (tmp_path / "source.c").read_text("ascii")
    example = example_in(text)
    head = prototypes_after(text, example)
    printed_angle = run_program(tmp_path, head, example, ["source.c"])

    mechanism = sk.load(name)
    inputs = inputs_of_example(example, count=len(mechanism.inputs))
    evaluation = sk.evaluate(mechanism, inputs, assembly_mode=0)
    expected_angle = np.ravel(evaluation.variable(pair_of_example(example, name)))[0]
    assert np.exp(1j * printed_angle) == pytest.approx(
        np.exp(1j * expected_angle), abs=1e-7
    )


def test_the_example_call_of_a_coupling_table_gives_the_first_variable(tmp_path):
    sk.export("four_bar", tmp_path / "table.h", to="coupling")
    example = example_in((tmp_path / "table.h").read_text("ascii"))
    printed = run_program(tmp_path, '#include "table.h"', example)
    q = float(re.search(r"q\[1\] = \{(.*?)\}", example)[1])
    expected = np.ravel(sk.evaluate("four_bar", [q], assembly_mode=0).variable("32"))
    assert np.exp(1j * printed) == pytest.approx(np.exp(1j * expected[0]), abs=1e-5)


@pytest.mark.parametrize(
    ("name", "pairs"), [("stephenson", ["34", "56"]), ("flat_foldable_vertex", ["c3"])]
)
def test_each_sign_is_named_by_the_middle_pair_of_its_dyad(name, pairs, tmp_path):
    sk.export(name, tmp_path / "source.c")
    text = (tmp_path / "source.c").read_text("ascii")
    assert re.findall(r"sign_\d+ \(.* the middle pair (\w+)\)", text) == pairs


def test_the_sign_of_a_dyad_that_replaces_a_contact_says_so(tmp_path):
    sk.export("roller_cam", tmp_path / "source.c")
    text = (tmp_path / "source.c").read_text("ascii")
    assert "the side of a dyad that replaces a contact" in text
