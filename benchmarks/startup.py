"""Whole processes: importing spherekit, and runs from the shell."""

import json
import subprocess
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path

from benchmarks.harness import Cell, Section, median, process, ratio, rounds

STEPS = {
    "import spherekit": "import spherekit",
    "load a mechanism": "import spherekit as sk; sk.load('four_bar')",
    "plan its poles": "import spherekit as sk; sk.plan(sk.load('four_bar'))",
    "trace its motion": "import spherekit as sk; sk.trace(sk.load('four_bar'))",
    "run poles on it": "import spherekit as sk; sk.run(sk.load('four_bar'))",
}
LOADED = (
    "import json, sys; print(json.dumps(sorted({name.split('.')[0] for name in "
    "sys.modules} - set(sys.stdlib_module_names))))"
)


def run(quick: bool) -> list[Section]:
    """Return the times of imports and of whole runs."""
    repeats = 3 if quick else 15
    return [_imports(repeats), _runs(3 if quick else 9)]


def _imports(repeats: int) -> Section:
    jobs: dict[str, Callable[[], object]] = {
        "nothing": process("-c", "pass"),
        "import numpy": process("-c", "import numpy"),
    }
    jobs |= {name: process("-c", code) for name, code in STEPS.items()}
    times = rounds(jobs, repeats, 0.0)
    rows: list[tuple[Cell, ...]] = []
    for name in jobs:
        code = STEPS.get(name, name if name.startswith("import") else "pass")
        rows.append(
            (
                name,
                1e3 * median(times, name),
                ratio(times, name, "import numpy"),
                ", ".join(_loaded(code)) or "none",
            )
        )
    return Section(
        "Import and first use",
        "Whole Python processes, files in the cache of the system.",
        ("process", "ms", "over import numpy", "loaded beside the standard library"),
        rows,
    )


def _loaded(code: str) -> list[str]:
    """Return the top-level modules that a program loads, standard library left out."""
    command = [sys.executable, "-c", f"{code}; {LOADED}"]
    out = subprocess.run(command, check=True, capture_output=True, text=True)
    before = [sys.executable, "-c", LOADED]
    none = subprocess.run(before, check=True, capture_output=True, text=True)
    return sorted(set(json.loads(out.stdout)) - set(json.loads(none.stdout)))


def _runs(repeats: int) -> Section:
    unit = "python -c 'import numpy, pandas'"
    with tempfile.TemporaryDirectory() as folder:
        target = str(Path(folder) / "out")
        recording = str(Path(folder) / "x.rrd")
        command = ("-m", "spherekit", "run", "four_bar", "-q")
        wanted = {
            unit: process("-c", "import numpy, pandas"),
            "spherekit run four_bar": process(*command),
            "spherekit run four_bar -o DIR": process(*command, "-o", target),
            "spherekit run four_bar --save X.rrd": process(*command, "--save", recording),
            "spherekit validate four_bar": process(
                "-m", "spherekit", "validate", "four_bar"
            ),
        }
        jobs = {name: job for name, job in wanted.items() if _works(job)}
        times = rounds(jobs, repeats, 0.0)
    rows: list[tuple[Cell, ...]] = [
        (name, 1e3 * median(times, name), ratio(times, name, unit))
        if name in times
        else (name, None, None)
        for name in wanted
    ]
    return Section(
        "Runs from the shell",
        "Whole processes, 361 samples of two assembly modes; the unit is what any program "
        "pays that writes its tables with pandas.",
        ("process", "ms", "over numpy and pandas"),
        rows,
    )


def _works(job: Callable[[], object]) -> bool:
    try:
        job()
    except subprocess.CalledProcessError as problem:
        print(problem.stderr.decode()[-2000:], file=sys.stderr)
        return False
    return True
