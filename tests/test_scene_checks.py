"""Scenes of wrong shape are refused in one sentence, and nothing else of a run is lost.

A scene is what an analysis shows on a page: primitives such as curves, arrows and plots,
whose arrays have a shape each.
"""

from dataclasses import dataclass, fields
from typing import ClassVar, final

import numpy as np
import pytest
from helpers.broken_plugins import Sound
from helpers.minimal_analysis import MinimalAnalysis

import spherekit as sk
from spherekit import plugin
from spherekit.cli.main import main
from spherekit.plugin import (
    ASSEMBLY_MODE,
    SAMPLE,
    STATUS,
    Arrow,
    Axis,
    Body,
    Column,
    Diagram,
    Graph,
    GreatCircle,
    InputMarks,
    Mark,
    Needs,
    PlaneCurve,
    Portrait,
    Scene,
    Series,
    SphereCurves,
    SphereMap,
    Surface,
    Table,
    Text,
    Trace,
    registered,
)
from spherekit.plugin.checks.suite import ConformanceSuite
from spherekit.scenes.scene_checks import ARRAY_SHAPES, check_scene

SAMPLES = 5
N3 = np.tile([0.0, 0.0, 1.0], (SAMPLES, 1))  # (samples, 3) unit vectors
LINE = np.linspace(0.0, 1.0, SAMPLES)  # (samples,) numbers
CORNERS = np.eye(3)
ONE_TRIANGLE = np.array([[0, 1, 2]])


def unchecked(kind, *values, **values_by_name):
    """Return an instance of a dataclass without the checks of its constructor.

    Tests create wrong primitives (parts of a drawing) with it. A plugin could do so too,
    with a class of its own that checks nothing.

    Parameters
    ----------
    kind
        Class of a primitive (curve, arrow, plot, ...) or of a scene (a drawing).
    *values, **values_by_name
        Values of its fields, in their order or by name. Other fields get their defaults.
    """
    instance = object.__new__(kind)
    names = [field.name for field in fields(kind)]
    given = dict(zip(names, values, strict=False)) | values_by_name
    for field in fields(kind):
        # `object.__setattr__` also assigns to frozen dataclasses.
        object.__setattr__(instance, field.name, given.get(field.name, field.default))
    return instance


def portrait(**changes):
    """Return a valid phase portrait of 5 samples with some fields changed, unchecked."""
    parts = {"x": LINE, "y": LINE, "x_range": (0, 1), "y_range": (0, 1)}
    return unchecked(Portrait, "p", "p", x_label="x", y_label="y", **(parts | changes))


def diagram(**changes):
    """Return a valid diagram of two points with some fields changed, unchecked."""
    parts = {
        "names": ("a", "b"),
        "places": np.zeros((SAMPLES, 2, 2)),
        "tones": (0, 1),
        "lines": np.zeros((SAMPLES, 1, 3)),
    }
    return unchecked(Diagram, "d", "d", "x", "y", (0, 1), (0, 1), **(parts | changes))


class DerivedMark(Mark):
    """A mark of a class that `ARRAY_SHAPES` does not contain."""


RIGHT = {
    "Series": Series("s", "s", "g", LINE),
    "Series as a list": Series("s", "s", "g", [1, 2, 3, 4, 5]),
    "Arrow": Arrow("a", "a", N3, False),
    "GreatCircle": GreatCircle("c", "c", N3),
    "Trace": Trace("t", "t", N3, 0, None),
    "Body": Body(
        "b", "b", [N3], N3[:2], ("1", "2"), 0, np.tile([0, 0, 0, 1], (SAMPLES, 1))
    ),
    "InputMarks": InputMarks("i", "i", np.zeros((2, 1))),
    "no InputMarks": InputMarks("i", "i", np.zeros((0, 1))),
    "Portrait": portrait(curves=[PlaneCurve(np.eye(2))], marks=[Mark("m", np.zeros(2))]),
    "SphereCurves": SphereCurves("c", "c", [N3], 0, [Mark("m", N3[0])]),
    "SphereMap": SphereMap("m", "m", CORNERS, ONE_TRIANGLE, LINE[:3]),
    "SphereMap of points": SphereMap("m", "m", CORNERS, np.empty((0, 3), int), LINE[:3]),
    "Surface": Surface("u", "u", CORNERS, ONE_TRIANGLE, ("x", "y", "z")),
    "Diagram": diagram(),
    "Graph": Graph("g", (("a", "a", 0), ("b", "b", None)), (("a", "b"),), ((0, 0), (1, 1))),
    "Text": Text("t", "t", "words"),
}
"""Valid primitives."""

WRONG = {
    "Series as a column": (
        unchecked(Series, "plots/x", "s", "g", LINE[:, None]),
        "Series 'plots/x': values has the shape (5, 1), but needs (n,)",
    ),
    "Series too short": (
        unchecked(Series, "s", "s", "g", LINE[:3]),
        "values has the shape (3,), but needs (n,); n is 5, the 5 samples of the block",
    ),
    "Series of texts": (unchecked(Series, "s", "s", "g", ["a"] * 5), "<U1 values"),
    "Series None": (unchecked(Series, "s", "s", "g", None), "values holds None"),
    "Series ragged": (
        unchecked(Series, "s", "s", "g", [[1], [1, 2]]),
        "rows of unequal length",
    ),
    "Series with a mask": (
        unchecked(Series, "s", "s", "g", np.ma.masked_greater(LINE, 0.5)),
        "values has masked values; it has to be an array without a mask",
    ),
    "Series of a set": (unchecked(Series, "s", "s", "g", {1.0}), "values holds a set;"),
    "path is a number": (
        unchecked(Series, 3, "s", "g", LINE),
        "path is 3; it has to be a text",
    ),
    "InputMarks 1-D": (unchecked(InputMarks, "i", "i", np.zeros(3)), "needs (k, axes)"),
    "InputMarks of two inputs": (
        unchecked(InputMarks, "i", "i", np.zeros((3, 2))),
        "inputs has 2 columns, but needs one for each axis: 1",
    ),
    "SphereCurves of a plane": (
        unchecked(SphereCurves, "c", "c", [N3, N3[:, :2]]),
        "curves[1] has the shape (5, 2), but needs (k, 3)",
    ),
    "SphereCurves not in a list": (
        unchecked(SphereCurves, "c", "c", N3),
        "curves[0] has the shape (3,)",
    ),
    "SphereCurves None": (unchecked(SphereCurves, "c", "c", None), "curves is a NoneType"),
    "marks of a plane": (
        unchecked(SphereCurves, "c", "c", [N3], 0, [unchecked(Mark, "m", np.zeros(2))]),
        "marks[0]: place has the shape (2,), but needs (d,); d is 3, coordinates",
    ),
    "SphereCurves in an array without axes": (
        unchecked(SphereCurves, "c", "c", np.array(1.0)),
        "curves is a ndarray; it has to be a sequence",
    ),
    "marks of a derived class": (
        unchecked(SphereCurves, "c", "c", [N3], 0, [unchecked(DerivedMark, "m", N3[0])]),
        "marks[0] is a DerivedMark; it has to be a Mark(...)",
    ),
    "marks as arrays": (
        unchecked(SphereCurves, "c", "c", [N3], 0, [N3[0]]),
        "has to be a Mark(...)",
    ),
    "Arrow (3, n)": (unchecked(Arrow, "a", "a", N3.T, False), "but needs (n, 3); n is 5"),
    "GreatCircle one": (unchecked(GreatCircle, "c", "c", N3[0]), "but needs (n, 3)"),
    "Trace quaternions": (
        unchecked(Trace, "t", "t", N3, 0, N3),
        "quaternions has the shape (5, 3)",
    ),
    "Body labels": (
        unchecked(Body, "b", "b", [N3], N3[:2], ("1",), 0, None),
        "joint_labels has 1 items, but needs 2, as many as the j of joints",
    ),
    "Portrait": (portrait(y=LINE[:4]), "y has the shape (4,), but needs (n,)"),
    "Portrait range": (portrait(x_range=(0, 1, 2)), "x_range has the shape (3,)"),
    "Portrait unit": (portrait(x_unit=None), "x_unit is None; it has to be a text"),
    "Portrait curve": (
        portrait(curves=[unchecked(PlaneCurve, N3)]),
        "curves[0]: points has the shape",
    ),
    "Portrait curve as an array": (portrait(curves=[N3]), "has to be a PlaneCurve(...)"),
    "SphereMap values": (
        unchecked(SphereMap, "m", "m", CORNERS, ONE_TRIANGLE, LINE),
        "values has the shape (5,), but needs (v,); v is 3, the v of vertices",
    ),
    "SphereMap corner": (
        unchecked(SphereMap, "m", "m", CORNERS, ONE_TRIANGLE + 1, LINE[:3]),
        "triangles has the corner 3, but the vertices have the numbers 0 to 2",
    ),
    "SphereMap corner without vertices": (
        unchecked(SphereMap, "m", "m", CORNERS[:0], ONE_TRIANGLE, LINE[:0]),
        "triangles has the corner 0, but there are no vertices",
    ),
    "SphereMap corners as floats": (
        unchecked(SphereMap, "m", "m", CORNERS, ONE_TRIANGLE * 1.0, LINE[:3]),
        "triangles contains float64 values",
    ),
    "Surface axes": (
        unchecked(Surface, "u", "u", CORNERS, ONE_TRIANGLE, ("x", "y")),
        "axes has 2 items, but needs 3",
    ),
    "Diagram names": (diagram(names=("a",)), "names has 1 items, but needs 2"),
    "Surface values unit": (
        unchecked(Surface, "u", "u", CORNERS, ONE_TRIANGLE, ("x", "y", "z"), values_unit=1),
        "values_unit is 1; it has to be a text",
    ),
    "Diagram words": (diagram(words=("a",)), "words has 1 texts"),
    "Diagram words in one text": (diagram(words="abcde"), "words is a str;"),
    "Diagram words None": (diagram(words=None), "words is a NoneType;"),
    "Diagram reading names": (
        diagram(reading_names=("a",)),
        "reading_names has 1 items, but needs 2",
    ),
    "Graph": (
        unchecked(Graph, "g", (("a", "a", 0),), (), ((0, 0), (1, 1))),
        "nodes has 1 items, but needs 2",
    ),
    "Text": (unchecked(Text, "t", "t", None), "markdown is None; it has to be a text"),
    "no primitive": (LINE, "primitives has a ndarray; allowed are Body, Arrow"),
    "a Mark alone": (unchecked(Mark, "m", N3[0]), "primitives has a Mark; allowed are"),
}
"""Primitives with one fault each, and a fragment of the sentence that refuses them."""


@pytest.mark.parametrize("name", RIGHT)
def test_right_scenes_pass(name):
    """A scene of page 0 in a run with assembly modes 0 and 1, 5 samples and 1 input."""
    scene = check_scene("any", Scene(0, (RIGHT[name],)), [0, 1], SAMPLES, 1)
    assert type(scene.primitives[0]) is type(RIGHT[name])


@pytest.mark.parametrize("name", WRONG)
def test_wrong_scenes_are_refused_in_a_sentence(name):
    """It names analysis and page; the run is that of `test_right_scenes_pass`."""
    primitive, fragment = WRONG[name]
    with pytest.raises(sk.SpherekitError) as refused:
        check_scene("any", unchecked(Scene, 0, (primitive,)), [0, 1], SAMPLES, 1)
    message = str(refused.value)
    assert message.startswith("any: scene of page 0: ") and fragment in message
    assert "\n" not in message


@pytest.mark.parametrize(
    ("scene", "fragment"),
    [
        (None, "scene returned a NoneType"),
        (
            unchecked(Scene, 7, ()),
            "not an assembly mode of the run; allowed are 0, 1",
        ),
        (
            unchecked(Scene, 0.5, ()),
            "a page is the number of an assembly mode, a title, or None",
        ),
        (unchecked(Scene, 0, None), "primitives is a NoneType; it has to be a tuple"),
        (unchecked(Scene, "own", (), (LINE,)), "over has to be a tuple of Axis(...)"),
        (
            unchecked(Scene, "own", (), (unchecked(Axis, "a", "", N3),)),
            "Axis 'a': values has the shape (5, 3)",
        ),
        (
            unchecked(Scene, "own", (), (unchecked(Axis, None, "", LINE),)),
            "label is None; it has to be a text",
        ),
        (
            unchecked(Scene, "own", (), (unchecked(Axis, "a", 1, LINE),)),
            "Axis 'a': unit is 1; it has to be a text",
        ),
        (
            unchecked(
                Scene,
                "own",
                (),
                (unchecked(Axis, "a", "", LINE), unchecked(Axis, "b", "", LINE[:2])),
            ),
            "Axis 'b' has 2 values, Axis 'a' has 5",
        ),
        (
            unchecked(
                Scene,
                "own",
                (unchecked(Series, "s", "s", "g", LINE[:4]),),
                (unchecked(Axis, "a", "", LINE),),
            ),
            "n is 5, the 5 values of a",
        ),
    ],
)
def test_wrong_pages_and_axes_are_refused(scene, fragment):
    """An axis has the values over which the rows of a scene are plotted, if not samples."""
    with pytest.raises(sk.SpherekitError, match="any: ") as refused:
        check_scene("any", scene, [0, 1], SAMPLES, 1)
    assert fragment in str(refused.value)


@final
@dataclass(frozen=True, kw_only=True)
class AnalysisWithWrongScene(MinimalAnalysis):
    """Analysis whose only scene has one wrong primitive, such as an array of wrong shape.

    A scene is a drawing that an analysis shows on a page of the results. It consists of
    primitives such as curves and arrows. The dictionary `WRONG` has wrong primitives and
    the messages that refuse them; `fault` is one of its keys. The command line calls this
    analysis "crooked". It is `rowwise`: it receives the samples in blocks.
    """

    name: ClassVar = "crooked"
    version: ClassVar = "1"
    summary: ClassVar = "a scene of a wrong shape"
    rowwise: ClassVar = True
    tables: ClassVar = (Table("rows", "of samples", (SAMPLE, ASSEMBLY_MODE)),)
    fault: str = "Series as a column"

    def needs(self, mechanism):
        """Return nothing: the table has numbers of samples and modes only."""
        return Needs()

    def compute(self, batch):
        """Return a row for each sample and assembly mode."""
        return {"rows": {"sample": batch.sample, "assembly_mode": batch.assembly_mode}}

    def scene(self, batch):
        """Return the scene with the fault that the parameter names."""
        primitive, _message = WRONG[self.fault]
        # Without the checks of the constructor. Page 0 is that of assembly mode 0.
        scene = unchecked(Scene, page=0, primitives=(primitive,))
        return (scene,)


@pytest.mark.slow
@pytest.mark.many
@pytest.mark.parametrize(
    "fault", ["Series as a column", "InputMarks 1-D", "SphereCurves of a plane"]
)
def test_a_command_with_a_wrong_scene_loses_no_other_result(fault, tmp_path, capsys):
    """A wrong drawing of one analysis leaves all other results of a command complete.

    The analysis "crooked" (`AnalysisWithWrongScene`) has one wrong primitive, which `fault`
    names. The exit status is 4, and one line names the analysis, the page and the fault.
    The second analysis, `poles`, still has its table and figures; the recording and the
    summary are complete.
    """
    pytest.importorskip("matplotlib")
    folder = tmp_path / "out"
    recording = folder / "four_bar.rrd"
    arguments = ["run", "four_bar", "--samples", str(SAMPLES), "-o", str(folder)]
    arguments += ["--figures", "--save", str(recording)]
    arguments += ["-a", f"crooked:fault={fault}", "-a", "poles"]
    with registered(AnalysisWithWrongScene):
        assert main(arguments) == 4
    output, errors = capsys.readouterr()
    lines = errors.splitlines()
    (line,) = [text for text in lines if "crooked" in text and "failed" in text]
    assert line.startswith("spherekit: analysis crooked failed: scene of page 0: ")
    # The message of `WRONG` has the form "PATH: FAULT, DETAILS".
    _, fragment = WRONG[fault]
    without_path_and_details = fragment.rpartition(": ")[2].split(",")[0]
    assert without_path_and_details in line
    assert "Traceback" not in errors
    assert recording.stat().st_size > 10_000  # bytes
    # Files are written under this name until they are complete.
    assert not [*folder.glob("*.part")]
    assert (folder / "poles.csv").exists()
    assert [*(folder / "figures").glob("poles*.png")]
    assert "assembly modes" in output  # of the printed summary


@pytest.mark.parametrize(
    "fault", ["Series as a column", "SphereCurves of a plane", "Body labels"]
)
def test_conformance_says_what_is_wrong_with_a_scene(fault):
    analysis = AnalysisWithWrongScene(fault=fault)
    report = ConformanceSuite(analysis, ["four_bar"], SAMPLES).report()
    assert report["scene"].verdict == "FAILS"
    assert "scene of page 0" in report["scene"].note
    assert all(line.verdict != "FAILS" for line in report if line.name != "scene")


def test_shapes_are_in_the_help_of_every_primitive():
    """The docstring of every primitive tells authors of plugins the shapes of its arrays.

    A primitive is a part of a drawing, such as a curve. `ARRAY_SHAPES` has the shapes that
    are checked, by class and field. Each such field needs a line in the docstring of its
    class, such as "points, normals : (n, 3) ...". `spherekit.plugin` must export the class.
    """
    for kind, shapes in ARRAY_SHAPES.items():
        description_by_field = {}
        for line in kind.__doc__.splitlines():
            names, colon, description = line.partition(" : ")
            if colon:
                for name in names.replace(",", " ").split():
                    assert name not in description_by_field
                    description_by_field[name] = description
        field_names = {field.name for field in fields(kind)}
        for name in shapes:
            assert name in field_names
            assert "(" in description_by_field[name], f"{kind.__name__}.{name}"
        assert getattr(plugin, kind.__name__) is kind


@final
@dataclass(frozen=True, kw_only=True)
class AnalysisWithoutSamples(MinimalAnalysis):
    """An analysis whose rows do not depend on the samples of the run.

    Tests use it to see that such rows are written.
    """

    name: ClassVar = "constant"
    version: ClassVar = "1"
    summary: ClassVar = "rows of its own"
    reads_samples: ClassVar = False
    tables: ClassVar = (
        Table("rows", "of its own", (SAMPLE, ASSEMBLY_MODE, Column("x", "", "x"), STATUS)),
    )
    rows: int = 3

    def compute(self, batch):
        """Return `self.rows` rows, of which the second has the status of a failure."""
        numbers = np.arange(self.rows)
        failed = np.where(numbers == 1, sk.Status.NOT_CONVERGED, sk.Status.OK)
        return {
            "rows": {
                "sample": numbers,
                "assembly_mode": 0 * numbers,
                "x": 1.0 * numbers,
                "status": failed,
            }
        }


@pytest.mark.parametrize("beside", [[], ["poles"]])
@pytest.mark.parametrize("rows", [0, 1, 3, 10, 20])
def test_an_analysis_without_samples_may_have_rows_that_name_samples(rows, beside):
    """Ten and twenty are also numbers of rows of the samples beside: five in two modes."""
    with registered(AnalysisWithoutSamples):
        result = sk.run("four_bar", [f"constant:rows={rows}", *beside], samples=SAMPLES)
    assert not result.failures
    assert len(result.frame("constant")) == rows
    analyses = result.summary["analyses"]
    (summary,) = [entry for entry in analyses if entry["name"] == "constant"]
    expected = {"rows": {"NOT_CONVERGED": 1}} if rows > 1 else {}
    assert summary["failed_rows"] == expected


def test_an_analysis_without_samples_passes_conformance():
    report = ConformanceSuite(AnalysisWithoutSamples(), ["four_bar"], SAMPLES).report()
    assert not report.failing, str(report)


@pytest.mark.slow
def test_conformance_says_that_the_main_table_was_empty():
    empty = AnalysisWithoutSamples(rows=0)
    report = ConformanceSuite(empty, ["four_bar", "five_bar"], SAMPLES).report()
    assert report["tables"].verdict == "not checked"
    assert "the main table rows is empty" in report["tables"].note
    sound = ConformanceSuite(Sound, ["four_bar"], SAMPLES).report()
    assert sound["tables"].verdict == "holds"
