"""Exported sources, compiled or run: each as a function of columns, as the terms are."""

import ctypes
import json
import shutil
import subprocess

import numpy as np

from spherekit.exchange.source_languages import source

GCC, GPP, NODE, JULIA = map(shutil.which, ("gcc", "g++", "node", "julia"))
STRICT = "-O2 -Wall -Wextra -Wconversion -pedantic -Werror -ffp-contract=off -shared -fPIC"


def compiled(path, language):
    """Return the library of a source that is compiled without a warning."""
    library = path.with_suffix(f".{language}.so")
    words = [GCC, "-std=c99"] if language == "c" else [GPP, "-std=c++11"]
    words += [*STRICT.split(), "-o", str(library), str(path), "-lm"]
    subprocess.run(words, check=True)
    return ctypes.CDLL(str(library))


def c_function(path, name, count, language):
    """Return a function of columns."""
    if language == "cpp":
        header, path = path, path.with_suffix(".cpp")
        call = f"{name}_formulas::{name}(motion, mode, size, result)"
        arguments = "const double *motion, const double *mode, const double *size"
        path.write_text(
            f'#include "{header.name}"\nextern "C" void {name}({arguments}, '
            f"double *result)\n{{\n    {call};\n}}\n"
        )
    function = getattr(compiled(path, language), name)

    def at(*columns):
        n = columns[0].shape[1]
        results = np.empty((n, count))
        given = [np.ascontiguousarray(np.vstack([x, np.zeros(n)]).T) for x in columns]
        pointers = ctypes.POINTER(ctypes.c_double)
        for k in range(n):
            function(*(x[k].ctypes.data_as(pointers) for x in (*given, results)))
        return results.T

    return at


def rows_as_lists(columns):
    """Return what each row of columns (k, n) is given, as lists."""
    return [[x[:, k].tolist() for x in columns] for k in range(columns[0].shape[1])]


def js_function(path, name):
    def at(*columns):
        program = path.with_name("run.mjs")
        program.write_text(
            f"import {{{name} as f}} from './{path.name}';\n"
            "import { readFileSync } from 'fs';\n"
            "const rows = JSON.parse(readFileSync(process.argv[2]));\n"
            "console.log(JSON.stringify(rows.map((x) => Array.from(f(...x)))));\n"
        )
        data = path.with_name("rows.json")
        data.write_text(json.dumps(rows_as_lists(columns)))
        done = subprocess.run(
            [NODE, str(program), str(data)], check=True, capture_output=True, text=True
        )
        return np.array(json.loads(done.stdout), dtype=float).T

    return at


def script(path, name):
    space = {}
    exec(compile(path.read_text("utf-8"), str(path), "exec"), space)
    return space[name]


def casadi_function(path, name):
    made = script(path, name)()
    return lambda *columns: np.array(made.map(columns[0].shape[1])(*columns))


def julia_function(path, name):
    def at(*columns):
        calls = "\n".join(
            f"println({name}({', '.join('Float64' + str(x) for x in row)}))"
            for row in rows_as_lists(columns)
        )
        program = path.with_name("run.jl")
        program.write_text(f'include("{path.name}")\n{calls}\n')
        done = subprocess.run(
            [JULIA, str(program)], check=True, capture_output=True, text=True
        )
        lines = done.stdout.replace("NaN", "nan").splitlines()
        return np.array([[float(x) for x in line[1:-1].split(",")] for line in lines]).T

    return at


def languages(tmp_path, name, made):
    """Yield each language with the function that its source is."""
    files = {"c": "x.c", "cpp": "x.hpp", "js": "x.mjs", "python": "x.py", "julia": "x.jl"}
    files["casadi"] = "casadi_x.py"
    available = {"c": GCC, "cpp": GPP, "js": NODE, "julia": JULIA, "python": "always"}
    try:
        import casadi  # noqa: F401

        available["casadi"] = "there"
    except ImportError:
        pass
    for language, file in files.items():
        if not available.get(language):
            continue
        path = tmp_path / file
        path.write_text(source(made, language))
        if language in ("c", "cpp"):
            yield language, c_function(path, name, len(made.results), language)
        elif language == "python":
            yield language, script(path, name)
        else:
            makers = {"js": js_function, "julia": julia_function, "casadi": casadi_function}
            yield language, makers[language](path, name)
