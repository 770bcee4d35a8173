"""Compiles or runs exported sources, so that tests can call them with columns of numbers.

Every source is wrapped as `function(*columns)` with columns (k, n): n rows of k numbers
per argument. It returns the results (count, n).
"""

import ctypes
import json
import shutil
import subprocess
from importlib.util import find_spec

import numpy as np

from spherekit.exchange.source_languages import source

GCC, GPP, NODE, JULIA = map(shutil.which, ("gcc", "g++", "node", "julia"))
STRICT = "-O2 -Wall -Wextra -Wconversion -pedantic -Werror -ffp-contract=off -shared -fPIC"


def compile_shared_library(path, language):
    """Compile a C or C++ source as strictly as possible and return the loaded library."""
    library = path.with_suffix(f".{language}.so")
    command = [GCC, "-std=c99"] if language == "c" else [GPP, "-std=c++11"]
    command += [*STRICT.split(), "-o", str(library), str(path), "-lm"]
    subprocess.run(command, check=True)
    return ctypes.CDLL(str(library))


def c_function(path, name, count, language):
    """Compile an exported C or C++ function and return it as a function of columns.

    The exported function computes the results of one row. Tests call the returned function
    for n rows at once. Its arguments `columns` are arrays (k, n), one for each argument of
    the exported function, which has k numbers. It returns the results (count, n).

    Parameters
    ----------
    path
        Source file.
    name
        Name of the exported function.
    count
        Number of results per row.
    language
        `"c"` or `"cpp"`.
    """
    if language == "cpp":
        # The exported file is a header. A source with C linkage, written here, calls it.
        header = path
        path = header.with_suffix(".cpp")
        call = f"{name}_formulas::{name}(motion, mode, size, result)"
        arguments = "const double *motion, const double *mode, const double *size"
        path.write_text(
            f'#include "{header.name}"\nextern "C" void {name}({arguments}, '
            f"double *result)\n{{\n    {call};\n}}\n"
        )
    function = getattr(compile_shared_library(path, language), name)

    def evaluate_columns(*columns):
        row_count = columns[0].shape[1]
        results = np.empty((row_count, count))
        # The function gets the address of each row, so each row must be contiguous. An
        # argument without numbers (k = 0) has no address, so a zero is added to every row.
        zeros = np.zeros(row_count)
        arguments = [np.ascontiguousarray(np.vstack([x, zeros]).T) for x in columns]
        pointer_type = ctypes.POINTER(ctypes.c_double)
        for row in range(row_count):
            function(*(x[row].ctypes.data_as(pointer_type) for x in (*arguments, results)))
        return results.T

    return evaluate_columns


def rows_as_lists(columns):
    """Return the arguments of each row of columns (k, n) as lists of numbers."""
    return [[x[:, k].tolist() for x in columns] for k in range(columns[0].shape[1])]


def js_function(path, name):
    """Return an exported JavaScript function, run by Node, as a function of columns.

    Each argument of the exported function `name` is a vector. Tests give n vectors of k
    numbers at once, as the columns of an array (k, n). The returned array (count, n) has a
    column of results for each call.
    """

    def evaluate_columns(*columns):
        program = path.with_name("run.mjs")
        program.write_text(
            f"import {{{name} as f}} from './{path.name}';\n"
            "import { readFileSync } from 'fs';\n"
            "const rows = JSON.parse(readFileSync(process.argv[2]));\n"
            "console.log(JSON.stringify(rows.map((x) => Array.from(f(...x)))));\n"
        )
        data = path.with_name("rows.json")
        data.write_text(json.dumps(rows_as_lists(columns)))
        process = subprocess.run(
            [NODE, str(program), str(data)], check=True, capture_output=True, text=True
        )
        return np.array(json.loads(process.stdout), dtype=float).T

    return evaluate_columns


def python_function(path, name):
    """Execute a Python source and return the function of this name."""
    namespace = {}
    exec(compile(path.read_text("utf-8"), str(path), "exec"), namespace)
    return namespace[name]


def casadi_function(path, name):
    """Return an exported CasADi function as a function of columns."""
    function = python_function(path, name)()
    return lambda *columns: np.array(function.map(columns[0].shape[1])(*columns))


def julia_function(path, name):
    """Return an exported Julia function as a function of columns.

    Each argument of the exported function `name` is a vector. Tests give n vectors of k
    numbers at once, as the columns of an array (k, n). The returned array (count, n) has a
    column of results for each call. A program written here
    calls the function once for each row, and its output is read.
    """

    def evaluate_columns(*columns):
        calls = []
        for row in rows_as_lists(columns):
            arguments = ", ".join(f"Float64{values}" for values in row)
            calls.append(f"println({name}({arguments}))")
        program = path.with_name("run.jl")
        program.write_text("\n".join([f'include("{path.name}")', *calls, ""]))
        process = subprocess.run(
            [JULIA, str(program)], check=True, capture_output=True, text=True
        )
        # Julia prints a vector as [1.0, NaN].
        lines = process.stdout.replace("NaN", "nan").splitlines()
        return np.array([[float(x) for x in line[1:-1].split(",")] for line in lines]).T

    return evaluate_columns


def functions_by_language(folder, name, formulas):
    """Yield each installed language and the function that its exported source defines.

    Tests compare the results of the same formulas in all languages. The functions take
    arrays (k, n), k numbers in each of n rows for each argument. They return (results, n).

    Parameters
    ----------
    folder
        Folder for the source files.
    name
        Name of the exported function.
    formulas
        Formulas that are exported.
    """
    file_names = {
        "c": "x.c",
        "cpp": "x.hpp",
        "js": "x.mjs",
        "python": "x.py",
        "julia": "x.jl",
        "casadi": "casadi_x.py",
    }
    is_installed = {
        "c": GCC is not None,
        "cpp": GPP is not None,
        "js": NODE is not None,
        "python": True,
        "julia": JULIA is not None,
        "casadi": find_spec("casadi") is not None,
    }
    for language, file_name in file_names.items():
        if not is_installed[language]:
            continue
        path = folder / file_name
        path.write_text(source(formulas, language))
        if language in ("c", "cpp"):
            function = c_function(path, name, len(formulas.results), language)
        elif language == "python":
            function = python_function(path, name)
        elif language == "js":
            function = js_function(path, name)
        elif language == "julia":
            function = julia_function(path, name)
        else:
            function = casadi_function(path, name)
        yield language, function
