"""Folded paper: shipped folds against closed forms, and files of new vertices."""

from itertools import product

import numpy as np
import pytest

import spherekit as sk
from spherekit.cli.main import main
from spherekit.files.mechanism_reader import loads

# Fold angles are 0 where the two sectors beside a crease are in one plane, positive for a
# valley fold and negative for a mountain fold.


def fold_angles(result, mode):
    """Return the fold angles (rad) of all creases in one assembly mode, by crease."""
    motion = result.frame("motion").query("assembly_mode == @mode")
    assert set(motion["status"]) == {"OK"}
    return {
        name.removeprefix("theta_"): motion[name].to_numpy()
        for name in motion
        if name.startswith("theta_")
    }


def half_tangents(angles):
    """Return the tangents of half the fold angles, by crease."""
    return {crease: np.tan(values / 2.0) for crease, values in angles.items()}


def test_half_tangents_of_a_flat_foldable_vertex_have_constant_ratios():
    """The half tangents of the fold angles of a flat-foldable vertex have constant ratios.

    Reference: the closed form for vertices of four creases c1 to c4 in which opposite
    sectors add up to 180 deg (Kawasaki's condition). The fold angles of opposite creases
    have equal magnitudes. The sector angles are s1 (between c1 and c2) and s2 (between c2
    and c3). In mode 0 with c1 = c3, tan(c2/2) is -cos((s1 + s2)/2) / cos((s1 - s2)/2) times
    tan(c1/2). In mode 1 with c1 = -c3 the factor is sin((s1 + s2)/2) / sin((s1 - s2)/2). A
    mode is named by the crease that folds unlike the others. `fold_angles` returns the
    angles of a run by crease.
    """
    result = sk.run("flat_foldable_vertex", samples=13)
    names = [mode["name"] for mode in result.summary["assembly_modes"]]
    assert names == ["mountain_c2", "mountain_c3"]
    half_sum, half_difference = np.radians([(100.0 + 60.0) / 2.0, (100.0 - 60.0) / 2.0])
    ratios = (
        -np.cos(half_sum) / np.cos(half_difference),
        np.sin(half_sum) / np.sin(half_difference),
    )
    for mode, (sign, ratio) in enumerate(zip((1.0, -1.0), ratios, strict=True)):
        tangents = half_tangents(fold_angles(result, mode))
        assert tangents["c3"] == pytest.approx(sign * tangents["c1"], rel=1e-12)
        assert tangents["c2"] == pytest.approx(ratio * tangents["c1"], rel=1e-12)
        assert tangents["c4"] == pytest.approx(-sign * tangents["c2"], rel=1e-12)
        # Maekawa's condition: of four creases, three fold the same way.
        valleys = sum(values[0] > 0.0 for values in tangents.values())
        assert valleys == 3


@pytest.mark.slow
def test_the_miura_unit_folds_as_one_by_its_closed_form():
    """The first mode of `miura_unit` is the Miura fold: tan(h/2) = cos(60 deg) tan(z/2).

    The sheet has 3 x 3 facets. A zigzag line runs between two columns of facets: its pieces
    z11, z21 and z31 have the fold angle z, and those of the second line -z. The pieces h11
    to h13 and h21 to h23 of the two straight lines have the angles h and -h in turn.
    `fold_angles` returns the angles of a run by crease.
    """
    result = sk.run("miura_unit", samples=9)
    mode = next(m for m in result.summary["assembly_modes"] if m.get("name") == "miura")
    assert mode["number"] == 0
    # The count of links and pairs gives the mobility 0. One constraint is redundant, so the
    # rank of all constraints gives 1.
    assert result.summary["mobility"] == {"graph": 0, "rank": 1}
    angles = fold_angles(result, 0)
    z = angles["z11"]
    h = 2.0 * np.arctan(0.5 * np.tan(z / 2.0))
    for row in (1, 2, 3):
        assert angles[f"z{row}1"] == pytest.approx(z, rel=1e-11)
        assert angles[f"z{row}2"] == pytest.approx(-z, rel=1e-11)
    for row in (1, 2):
        for column in (1, 2, 3):
            sign = (-1.0) ** (row + column)
            assert angles[f"h{row}{column}"] == pytest.approx(sign * h, rel=1e-11)
    # Facets two rows and two columns apart only translate relative to each other.
    frame = result.frame()
    corner = frame.query("assembly_mode == 0 and link == 'f33' and relative_to == 'f11'")
    assert set(corner["status"]) == {"NO_POLE"}


def test_a_positive_fold_angle_is_a_valley_of_a_vertex():
    """A sector rises above the plane of the one before it where their crease is a valley.

    The normals of sectors point to the side from which the creases are counter-clockwise.
    """
    mechanism = sk.load("flat_foldable_vertex")
    motion = sk.trace(mechanism, samples=5, assembly_mode=1)
    creases = [f"c{k}" for k in range(1, 5)]
    axes = {c: motion.axes[:, mechanism.pair_number[c]] for c in creases}
    for k, crease in enumerate(creases):
        normal = np.cross(axes[creases[k - 1]], axes[crease])
        height = np.sum(normal * axes[creases[(k + 1) % 4]], axis=1)
        assert np.array_equal(height > 0.0, fold_variable(motion, crease) > 0.0)


@pytest.fixture(scope="module")
def miura_fold():
    """Return the Miura fold at five inputs, and the directions (5, 3) of creases by name.

    The sheet has 3 x 3 facets. The crease hRC, below the facet fRC, points to the right;
    the crease zRC, to the right of the facet, points upwards::

        f11   z11   f12   z12   f13
        -h11>       -h12>       -h13>
        f21   z21   f22   z22   f23
        -h21>       -h22>       -h23>
        f31   z31   f32   z32   f33
    """
    mechanism = sk.load("miura_unit")
    motion = sk.trace(mechanism, samples=5, assembly_mode=0)
    creases = {name: motion.axes[:, k] for name, k in mechanism.pair_number.items()}
    return motion, creases


def rises_above_facet(right, up, direction):
    """Return whether a direction (n, 3) rises above a facet.

    `right` and `up` are the directions (n, 3) of two creases of this facet, to the right
    and upwards in the sheet, so that right x up points out of the paper.
    """
    normal = np.cross(right, up)
    return np.sum(normal * direction, axis=1) > 0.0


ROWS_AND_COLUMNS = pytest.mark.parametrize(
    ("row", "column"), list(product((1, 2), repeat=2))
)


@ROWS_AND_COLUMNS
def test_a_positive_fold_angle_is_a_valley_at_creases_to_the_right(row, column, miura_fold):
    """The facet above a valley hRC rises above the plane of the facet below it.

    The facet below is f(R + 1)C, with the creases hRC and z(R + 1)C. The facet above is
    fRC. It extends from hRC along its right border zRC.
    """
    motion, creases = miura_fold
    h = f"h{row}{column}"
    rises = rises_above_facet(
        right=creases[h],
        up=creases[f"z{row + 1}{column}"],
        direction=creases[f"z{row}{column}"],
    )
    assert np.array_equal(rises, fold_variable(motion, h) > 0.0)


@ROWS_AND_COLUMNS
def test_a_positive_fold_angle_is_a_valley_at_creases_upwards(row, column, miura_fold):
    """The facet left of a valley zRC rises above the plane of the facet right of it.

    The facet on the right is fR(C + 1), with the creases hR(C + 1) and zRC. The facet on
    the left is fRC. It extends from zRC against its lower border hRC.
    """
    motion, creases = miura_fold
    z = f"z{row}{column}"
    rises = rises_above_facet(
        right=creases[f"h{row}{column + 1}"],
        up=creases[z],
        direction=-creases[f"h{row}{column}"],
    )
    assert np.array_equal(rises, fold_variable(motion, z) > 0.0)


def fold_variable(motion, crease):
    """Return the fold angles (rad) of one crease at all rows of a motion."""
    return motion.values[:, motion.mechanism.angles[crease]]


@pytest.mark.slow
def test_the_plan_of_an_over_constrained_fold_is_found_by_rank():
    """In Python as on the command line, a facet beside another one has a crease as pole."""
    plan = sk.plan("miura_unit")
    table = sk.table(plan)
    assert len(table.splitlines()) == 10
    assert table.count("x") == 2 * 12  # each crease is the pole of two facets
    with pytest.raises(sk.SpherekitError, match="rigid"):
        sk.plan(sk.lock(sk.load("flat_foldable_vertex"), {"c2": 0.3}, angle_unit="rad"))


def write_vertex(folder, sectors, name="vertex"):
    """Write the file of a new vertex with the command; return its path."""
    path = folder / f"{name}.toml"
    command = ["new", "mechanism", str(path), "--kind", "vertex", "--sectors", sectors]
    assert main([*command, "-q"]) == 0
    return path


VERTICES = {
    "flat-foldable": "100,60,80,120",
    "flat, not flat-foldable": "100,70,90,100",
    "five creases": "80,75,60,70,75",
    "six equal creases": "60,60,60,60,60,60",
    "seven creases of a cone": "70,40,60,50,30,50,60",
    "pyramid": "50,50,50,50",
    "saddle": "100,110,90,120",
}
"""Sector angles of vertices, degrees. The last three cannot be laid flat."""


@pytest.mark.parametrize("sectors", VERTICES.values(), ids=VERTICES)
def test_a_new_vertex_closes_in_its_whole_range_in_both_modes(sectors, tmp_path):
    """The file that the command writes for a new folded vertex closes at all its inputs.

    Walking around the vertex, each sector turns a frame about x by its angle and each
    crease about z by its fold angle. After one round the product of these rotations must be
    the identity. `write_vertex` writes the file and `fold_angles` reads the angles of a
    run. The middle of the last three creases is a valley in mode 0 (+) and a mountain in
    mode 1 (-).
    """
    path = write_vertex(tmp_path, sectors)
    sector_angles = np.radians([float(angle) for angle in sectors.split(",")])
    n = len(sector_angles)
    mechanism = sk.load(path)
    assert len(mechanism.inputs) == n - 3
    result = sk.run(mechanism, samples=7)
    assert [mode["mode"] for mode in result.summary["assembly_modes"]] == ["+", "-"]
    for mode, sign in ((0, 1.0), (1, -1.0)):
        angles = fold_angles(result, mode)
        # The range of a new file leaves out fold angles below 5 deg.
        assert np.all(sign * angles[f"c{n - 1}"] > np.radians(4.99))
        for sample in range(7):
            frame = np.eye(3)
            for k, sector in enumerate(sector_angles, 1):
                frame = frame @ about_z(angles[f"c{k}"][sample]) @ about_x(sector)
            assert frame == pytest.approx(np.eye(3), abs=1e-12)


@pytest.mark.slow
@pytest.mark.parametrize("crease_count", range(4, 10))
def test_the_output_of_a_new_vertex_moves_with_every_driven_crease(crease_count, tmp_path):
    """The output of a new folded vertex depends on every driven crease.

    Each driven crease is turned alone by 1e-3 rad from the middle of its range, and the
    output must move. The output is a direction in a link, or the orientation of the link.
    `write_vertex` runs the command `spherekit new mechanism`, which writes the file.
    """
    sectors = np.resize([50.0, 40.0, 60.0], crease_count)
    path = write_vertex(tmp_path, ",".join(f"{angle:g}" for angle in sectors))
    mechanism = sk.load(path)
    (output,) = mechanism.outputs
    angles = np.array([(item.start + item.stop) / 2.0 for item in mechanism.inputs])
    turned = [angles, *(angles + 1e-3 * np.eye(len(angles)))]
    poses = []
    for values in turned:
        rotation = sk.evaluate(mechanism, values, assembly_mode=0).rotation(output.link)
        is_pointed = output.direction is not None
        poses.append(rotation @ output.direction if is_pointed else rotation)
    for pose in poses[1:]:
        assert np.abs(pose - poses[0]).max() > 1e-5


def about_x(angle):
    """Return the matrix of a rotation about the x axis by an angle (rad)."""
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[1.0, 0.0, 0.0], [0.0, c, -s], [0.0, s, c]])


def about_z(angle):
    """Return the matrix of a rotation about the z axis by an angle (rad)."""
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def test_the_range_of_a_new_vertex_is_the_longest(tmp_path):
    """The input range that the command chooses for a vertex is as long as possible.

    The vertex is a point of a folded paper where four creases meet. The command `new`
    writes its file, with a range in whole degrees for the input, the fold angle of c1. In
    this range the fold angle of c3, the opposite crease, must be at least 5 deg away from 0
    and 180 deg (`FOLD_MARGIN_DEG`). At each end of the range this must hold, and one degree
    beyond it must not.

    The creases c1 to c4 are the corners of a spherical quadrilateral. The sector angles s1
    to s4 are its sides: s1 from c1 to c2, and so on. The angle of the quadrilateral at a
    crease is 180 deg minus its fold angle. The arc from c2 to c4 divides the quadrilateral
    into triangles with the angles at c1 and c3. The cosine rule in both gives c3 from the
    input c1.
    """
    text = write_vertex(tmp_path, "100,70,90,100").read_text("utf-8")
    mechanism = loads(text)
    (item,) = mechanism.inputs
    low, high = np.degrees([item.start, item.stop])
    s1, s2, s3, s4 = np.radians([100.0, 70.0, 90.0, 100.0])
    c1 = np.radians([low - 1.0, low, high, high + 1.0])
    cos_corner_1 = -np.cos(c1)  # cos(180 deg - c1)
    cos_arc = np.cos(s4) * np.cos(s1) + np.sin(s4) * np.sin(s1) * cos_corner_1
    cos_corner_3 = (cos_arc - np.cos(s2) * np.cos(s3)) / (np.sin(s2) * np.sin(s3))
    cos_c3 = -cos_corner_3
    # Whether c3 is from 5 to 175 deg.
    is_inside = np.abs(cos_c3) <= np.cos(np.radians(5.0))
    assert is_inside.tolist() == [False, True, True, False]


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (["--sectors", "100,60,80,120"], "add --kind vertex"),
        (["--kind", "cam", "--sectors", "100,60,80,120"], "add --kind vertex"),
        (
            ["--kind", "vertex", "--sectors", "100,60,80"],
            "found 3 angles, expected 4 to 12",
        ),
        (["--kind", "vertex", "--sectors", "200,60,80,90"], "sector 1 has 200 deg"),
        (["--kind", "vertex", "--sectors", "170,10,20,30"], "no fold angles were found"),
        (
            # Each sector is smaller than the others together, but three are 510 > 370 deg.
            ["--kind", "vertex", "--sectors", "170,170,170,10"],
            "any three sectors together smaller than the sum of the others plus 360 deg",
        ),
    ],
)
def test_sectors_that_make_no_vertex_are_refused(words, expected, tmp_path, capsys):
    path = tmp_path / "vertex.toml"
    assert main(["new", "mechanism", str(path), *words]) == 1
    assert expected in " ".join(capsys.readouterr().err.split())
    assert not path.exists()
