"""What a run tells a recorder, poles of a mechanism, and the Table of the lecture."""

from dataclasses import replace
from typing import ClassVar

import pytest

import spherekit as sk
from spherekit.files.mechanism_reader import read
from spherekit.files.number_change import document_of, number_path, with_numbers
from spherekit.planning.pole_plan import all_poles
from spherekit.positions import assembly_mode as assembly_mode
from spherekit.positions.position_analysis import PositionAnalysis
from spherekit.runs.contract import AbstractAnalysis
from spherekit.runs.needs import Needs
from spherekit.symbolic.compiler import available
from spherekit.symbolic.expression_evaluation import float_function
from spherekit.symbolic.expression_graph import symbols
from spherekit.symbolic.parsed_expressions import convert_to_graph
from spherekit.velocities.pole_evaluation import evaluate
from spherekit.velocities.pole_request import request

compiled = pytest.mark.skipif(not available(), reason="heyoka is not installed")
ENGINES = (pytest.param("compiled", marks=compiled), "numpy")


class Listener:
    """Keeps what a recorder is told."""

    def __init__(self):
        self.rows, self.paths, self.when = {}, set(), []
        self.scenes, self.pages, self.logged = [], {}, []

    def start(self, head):
        self.inputs, self.focus, self.row = head.inputs, head.focus, head.row
        self.properties = head.properties
        self.assembly_modes, self.times = head.assembly_modes, head.times
        self.still = [p.path for scene in head.scenes for p in scene.primitives]

    def log(self, scene, samples, inputs=None, times=None):
        self.when.append(len(samples))
        self.scenes.append(scene)
        self.pages.setdefault(scene.page, []).extend(scene.primitives)
        self.logged.append((scene.page, samples.tolist(), inputs, times))
        for primitive in scene.primitives:
            self.paths.add(primitive.path)
            key = (scene.page, primitive.path)
            self.rows.setdefault(key, []).extend(samples)

    def last(self, page):
        """Return the last scene of a page, and of how many samples it is."""
        (*_, found) = (k for k, each in enumerate(self.scenes) if each.page == page)
        return self.scenes[found], self.when[found]

    def of(self, kind, page):
        """Return the primitives of a kind on a page, by their paths."""
        return {p.path: p for p in self.pages.get(page, ()) if isinstance(p, kind)}


def told_by(analysis, mechanism, **parameters):
    """Run an analysis alone, that reads no samples; its result and its findings."""
    text = ",".join(f"{key}={value}" for key, value in parameters.items())
    result = sk.run(mechanism, f"{analysis}:{text}")
    assert not result.failures
    (own,) = result.summary["analyses"]
    return result, own["findings"]


def bare(name):
    """Return a shipped mechanism without its masses and loads."""
    return replace(sk.load(name), masses=(), loads=())


def with_values(subject, values):
    """Return the mechanism of a file with other numbers, by their keys, in its units."""
    document = document_of(subject)
    numbers = {number_path(document, key): value for key, value in values.items()}
    return read(with_numbers(document, numbers))


def field_of(made, samples=361, search=True, wanted=None):
    tracer = PositionAnalysis(made, search=search, samples=samples)
    poles = all_poles(len(made.links)) if wanted is None else wanted
    asked = request(tracer.mechanism, tracer.mechanism.inputs[0].pair, poles, poles)
    motion = tracer.motion()
    return motion, evaluate(motion, asked)


def as_floats(expression, names):
    """Return an expression as a function of floats in the order of names."""
    terms = symbols(names)
    named = {name: (term, term) for name, term in zip(names, terms, strict=True)}
    made = float_function([convert_to_graph(expression, named)], terms)
    return lambda row: made(row)[0]


def distribution(folder, name, *lines):
    """Put a distribution with such lines of entry points into a folder."""
    info = folder / f"{name}-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text("\n".join([*lines, ""]))


def with_springs(*pairs):
    """Return the four-bar with springs that remember how often they were wound."""
    springs = [sk.PairTorque(f"at_{p}", p, f"-0.3*theta_{p}") for p in pairs]
    made = sk.load("four_bar")
    return replace(made, loads=(*made.loads, *springs))


class Asking(AbstractAnalysis):
    """An analysis of a test, which asks for nothing unless it says so."""

    version: ClassVar = "1"
    summary: ClassVar = "of a test"

    def needs(self, mechanism):
        return Needs()


def rows_of(batch, **columns):
    """Return the columns of a table with a row for each of a batch."""
    return {"sample": batch.sample, "assembly_mode": batch.assembly_mode, **columns}


LECTURE_TABLE = [
    ["■", "x", "I", "x", "II", "x"],
    ["x", "■", "x", "I", "III", "III"],
    ["I", "x", "■", "x", "x", "II"],
    ["x", "I", "x", "■", "III", "III"],
    ["II", "III", "x", "III", "■", "x"],
    ["x", "III", "II", "III", "x", "■"],
]
"""Di Gregorio 2019, lecture 2, case study 'Spherical Stephenson Mechanism'."""
