"""Singularities at the right input, in range or marked; searches that end and say so."""

import numpy as np
import pytest
from helpers.refusals import mechanism_text
from mechanism_examples.named_mechanisms import four_bar
from oracles.four_bar_singularities import (
    ROCKER,
    angles_with_links_in_line,
    axes_at_configuration,
    findings_and_warnings,
)
from scipy.optimize import brentq
from scipy.spatial.transform import Rotation

import spherekit as sk
from spherekit import progress
from spherekit.completeness import Guarantee
from spherekit.outputs.mid_plane_loci import mid_plane_loci
from spherekit.positions.position_analysis import PositionAnalysis
from spherekit.singularities.singular_curves import singular_curves
from spherekit.singularities.singular_surface import singular_surface
from spherekit.time_limit import TimeLimit

NAME = "singularities"
GEARED = mechanism_text("geared_five_bar_singular_roots")
"""A five-bar whose cranks are wheels of 20 and 40 teeth: the input comes back after 720."""


def geared(tmp_path, low, high):
    path = tmp_path / "geared.toml"
    path.write_text(GEARED.format(low=low, high=high))
    return sk.load(path)


def dead_inputs_of_geared(made, low, high):
    """Return where coupler and follower are in line: wheels on fixed axes, turned by hand.

    One configuration is read off the motion; from there the wheels turn by the teeth.
    """
    motion = PositionAnalysis(made, samples=61).motion()
    row = int(np.flatnonzero(~motion.failed)[0])
    axes, number = (
        axes_at_configuration(made, motion.values[row : row + 1])[0],
        made.pair_number,
    )
    left, right, one, other = (axes[number[name]] for name in ("left", "right", "32", "54"))

    def gap(q, across):
        turned = np.atleast_1d(q)[:, None] - motion.inputs[row, 0]
        first = Rotation.from_rotvec(turned * left).apply(one)
        second = Rotation.from_rotvec(-turned * 20 / 40 * right).apply(other)
        return np.arccos(np.sum(first * second, axis=1)) - across

    grid, found = np.linspace(low, high, 2001), []
    for across in np.radians([60.0 + 55.0, 60.0 - 55.0]):
        for k in np.flatnonzero(np.diff(np.sign(gap(grid, across)))):
            found.append(
                brentq(lambda q, a=across: gap(q, a)[0], *grid[k : k + 2], xtol=1e-14)
            )
    return np.sort(found)


@pytest.mark.many
@pytest.mark.parametrize(
    ("low", "high"),
    [
        (400.0, 620.0),
        pytest.param(0.0, 720.0, marks=pytest.mark.long),
        (-360.0, 360.0),
        pytest.param(-300.0, 1000.0, marks=pytest.mark.long),
    ],
)
def test_places_of_a_geared_five_bar_are_at_their_turn(low, high, tmp_path):
    made = geared(tmp_path, low, high)
    truth = dead_inputs_of_geared(made, *np.radians([low, high]))
    assert len(truth)
    result = sk.run(made, NAME, samples=13)
    frame = result.frame()
    inside = frame[frame["inside"] == "yes"]
    assert set(inside["kind"]) == {"II"}
    assert np.unique(np.round(inside["q"], 7)) == pytest.approx(truth, abs=1e-7)
    outside = frame[frame["inside"] == "no"]["q"]
    assert np.all((outside < np.radians(low)) | (outside > np.radians(high)))


DWELL = mechanism_text("dwell_drive")
"""A cam swings a wheel that turns the crank of a four-bar: what has rolled at an input
does not grow with the input, but comes back with it."""


def test_what_lies_outside_the_range_is_marked_at_the_nearest_turn():
    """Dead centres of a rocker: coupler and follower in line, an angle of their arcs."""
    turn = np.max(angles_with_links_in_line(*ROCKER))
    whole = sk.run(four_bar(ROCKER), NAME, samples=9).frame()
    dead = np.sort(whole[whole["kind"] == "II"]["q"])
    assert np.min(np.abs(np.mod(dead - turn + np.pi, 2 * np.pi) - np.pi)) < 1e-9
    low, high = dead[0] - 0.3, dead[0] - 0.1
    path = np.linspace(low, high, 9)[:, None]
    result = sk.run(four_bar(ROCKER).with_inputs("21"), NAME, path=path)
    frame = result.frame()
    away = frame[frame["kind"] == "II"]
    assert set(away["inside"]) == {"no"}
    turned = away["q"].to_numpy() + 2 * np.pi * np.array([[0], [1], [-1]])
    gap, *again = np.maximum(low - turned, turned - high)
    assert np.all(gap > 0.0) and np.all(gap <= again)
    figures, _ = findings_and_warnings(result)
    assert "II" not in figures["singularities"] and figures["outside"]["II"] == len(away)


@pytest.mark.parametrize(("low", "high"), [(0.0, 720.0), (-500.0, 400.0), (10.0, 370.0)])
def test_places_are_listed_for_every_turn_of_a_range(low, high):
    """Dead centres of a rocker by the spherical law of cosines, at plus and minus."""
    turns = np.arange(-3, 4)[:, None] * 360.0 + np.degrees(
        angles_with_links_in_line(*ROCKER)
    )
    truth = np.sort(turns[(turns > low) & (turns < high)])
    made = four_bar(ROCKER).with_inputs("21")
    path = np.radians(np.linspace(low, high, 31))[:, None]
    result = sk.run(made, NAME, path=path)
    frame = result.frame()
    own = frame[frame["kind"] == "II"]
    assert np.degrees(np.sort(own["q"])) == pytest.approx(truth, abs=1e-7)
    assert set(own["inside"]) == {"yes"} and set(own["assembly_mode"]) == {"0+1"}
    figures, _ = findings_and_warnings(result)
    assert not figures["checks_failed"] and "complete" in figures["guarantee"]
    relation = result.frame(NAME, "relation")
    q, margin = (
        relation.dropna(subset="input_margin_II")[["q", "input_margin_II"]].to_numpy().T
    )
    leads = np.stack([q + margin, q - margin])[..., None] - np.radians(turns.ravel())
    assert len(q) and np.all(np.min(np.abs(leads), axis=(0, 2)) < 1e-7)


def test_a_place_at_both_ends_of_a_turn_is_listed_once():
    """90 + 40 = 60 + 70: at q = 180 deg the four-bar lies in one plane."""
    made = four_bar(np.radians([90.0, 40.0, 60.0, 70.0])).with_inputs("21")
    path = np.radians(np.linspace(-180.0, 180.0, 9))[:, None]
    result = sk.run(made, NAME, path=path)
    frame = result.frame()
    own = frame[frame["kind"] == "III"]
    assert len(own) == 1 and set(own["assembly_mode"]) == {"0+1"}
    assert abs(np.degrees(own["q"].iloc[0])) == pytest.approx(180.0)
    relation = result.frame(NAME, "relation")
    at = relation[relation["status"].astype(str) == "AT_SINGULARITY"]
    assert len(at) and set(at["type"]) == {"III"} and set(at["group"]) == {1}
    to, away = relation["input_margin_II"], np.pi - relation["q"].abs()
    assert to.count() > 9 and (to - away).abs().max() < 1e-11


def check_points(tracer, points, kind):
    """Put the inputs there: the loops are closed, and the passive pairs singular (II)."""
    made, solver = tracer.mechanism, tracer.solver
    driven = list(solver.driven)
    values = points.values.copy()
    turns = (points.inputs - values[:, driven]) / (2.0 * np.pi)
    assert np.max(np.abs(turns - np.round(turns)), initial=0.0) < 1e-9
    values[:, driven] = points.inputs
    at = solver.closure.at(values)
    assert np.max(at.closure_residual, initial=0.0) < 1e-12
    low, high = np.transpose([item.range for item in made.inputs])
    within = np.all((points.inputs >= low - 1e-9) & (points.inputs <= high + 1e-9), axis=1)
    assert np.array_equal(within, points.inside)
    passive = np.delete(np.arange(values.shape[1]), driven)
    sizes = np.linalg.svd(at.jacobian[:, :, passive], compute_uv=False)
    assert kind == "I" or np.max(sizes[:, -1], initial=0.0) < 1e-9


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["I", pytest.param("II", marks=pytest.mark.long)])
def test_surfaces_from_random_starts_are_at_the_inputs_given(kind):
    made = sk.load("three_rrr")
    mesh = singular_surface(made, kind, side=0.25, halved=1, slices_of_each=0)
    assert len(mesh.points.values) and mesh.claim.guarantee is Guarantee.SAMPLED
    assert np.all(mesh.points.inside)
    check_points(PositionAnalysis(made, samples=3), mesh.points, kind)
    ways = [mesh.triangles[:, [a, b]] for a, b in ((0, 1), (1, 2), (2, 0))]
    assert len(np.unique(np.concatenate(ways), axis=0)) == 3 * len(mesh.triangles)
    if kind == "I":  # whose sheets cross
        return
    ends = np.array([(item.start, item.stop) for item in made.inputs])
    off = np.abs(mesh.points.inputs[mesh.border][..., None] - ends)
    assert np.max(np.min(np.max(off, axis=1), axis=(1, 2))) < 1e-9
    one, other = mesh.triangles[:, 0], mesh.triangles[:, 1]
    away = mesh.points.values[one] - mesh.points.values[other]
    away -= 2.0 * np.pi * np.round(away / (2.0 * np.pi))
    assert np.max(np.linalg.norm(away, axis=1)) < 0.75 * 0.25


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["I", "II"])
def test_random_starts_meet_the_curves_that_slices_meet(kind):
    made = sk.load("five_bar")
    by_slices = singular_curves(made, kind, slices_of_each=4)
    by_starts = singular_curves(made, kind, slices_of_each=0)
    assert by_slices.claim.guarantee is Guarantee.TO_BOX
    assert by_starts.claim.guarantee is Guarantee.SAMPLED
    tracer = PositionAnalysis(made, samples=3)
    for each in by_slices.curves:
        check_points(tracer, each.points, kind)
        inside = each.points.rows(each.points.inside)
        curves = (other.traced[1] for other in by_starts.curves)
        hits = [curve.find(inside.values, inside.motion) for curve in curves]
        assert np.all(np.any(hits, axis=0))


def test_a_search_without_time_says_so():
    budget = TimeLimit(0.0, "curves of type II")
    found = singular_curves(sk.load("five_bar"), "II", budget=budget)
    result = sk.run(sk.load("agile_eye"), f"{NAME}:slices=6,seconds=0", samples=3)
    assert not found.curves and found.claim.guarantee is Guarantee.SAMPLED
    assert "stopped after 0 s of processor time" in found.claim.reason
    assert not len(result.frame()) and not len(result.frame(NAME, "aspects"))
    remarks = result.summary["remarks"]
    ended = [each for each in remarks if "stopped after 0 s of processor time" in each]
    for words in ("type II", "type I", "aspects"):
        assert any(words in each for each in ended)
    assert any("in every row of assembly modes 2, 3, 6, 7" in each for each in remarks)
    assert "type I of" not in " ".join(result.summary["warnings"])


def test_a_search_tells_what_it_does(monkeypatch):
    monkeypatch.setattr(progress, "REPORT_INTERVAL_S", 0.0)
    told = []
    with progress.progress_listener(told.append):
        singular_curves(sk.load("five_bar"), "II", slices_of_each=1)
    assert "search: slice 1 of 1" in told[0]
    assert any("curve 1 of type II" in words for words in told)


@pytest.mark.slow
def test_a_differential_is_singular_everywhere_and_has_no_regular_part():
    """One axis for both inputs and the output: two inputs always rest it in some motion."""
    result = sk.run(sk.load("bevel_differential"), f"{NAME}:input_grid=5", samples=5)
    relation = result.frame(NAME, "relation")
    assert set(relation["type"]) == {"I"}
    assert not len(result.frame(NAME, "aspects"))
    remarks = " ".join(result.summary["remarks"])
    assert remarks.count("of type I in every configuration") == 1
    assert "aspect" not in remarks
    assert (relation["input_rate"] > 0.0).all() and relation["c"].isna().all()


@pytest.mark.slow
def test_three_inputs_have_surfaces_by_default_and_every_vertex_a_reason():
    result = sk.run(sk.load("three_rrr"), f"{NAME}:input_grid=0", samples=3)
    frame = result.frame()
    assert {"I", "II"} == set(frame["kind"])
    assert frame["condition"].astype(bool).all()
    remarks = result.summary["remarks"]
    assert sum("random starts" in each for each in remarks) == 2


def test_a_driven_link_is_no_output_by_default():
    made = sk.load("four_bar").with_inputs("41")
    result = sk.run(made, NAME, samples=9)
    assert "4/1" not in set(result.frame(NAME, "relation")["output"])


@pytest.fixture(scope="module")
def mid_plane():
    made = sk.load("two_dof_spm")
    return made, {kind: mid_plane_loci(made, kind) for kind in ("I", "II")}


@pytest.mark.slow
def test_mid_plane_loci_are_singular(mid_plane):
    made, loci = mid_plane
    tracer = PositionAnalysis(made, samples=3)
    for kind, found in loci.items():
        assert found.curves
        for each in found.curves:
            check_points(tracer, each.points, kind)
            assert np.max(each.points.residual) < 1e-12


@pytest.mark.slow
def test_mid_plane_loci_of_type_one_are_circles_at_the_limit_of_reach(mid_plane):
    """There base axis and mid-plane are the leg's arc apart, 40 deg: n . b = sin 40 deg."""
    made, loci = mid_plane
    form = sk.mid_plane_form(made)
    for each in loci["I"].curves:
        normals, off = form.normals(each.points.orientation)
        assert np.max(off) < 1e-9
        heights = np.abs(normals @ form.plane.axes[list(form.plane.driven)].T)
        assert np.max(np.min(np.abs(heights - np.sin(np.radians(40.0))), axis=1)) < 1e-9


@pytest.mark.many
@pytest.mark.parametrize(
    "name", ["shaped_flat_cam", "shaped_cam", "roller_cam", "four_bar", "stephenson", DWELL]
)
def test_the_output_reverses_where_it_is_said_to(name, tmp_path):
    """Signs of the velocity coefficient at samples against the places between them."""
    (tmp_path / "dwell.toml").write_text(DWELL)
    made = sk.load(tmp_path / "dwell.toml" if name == DWELL else name)
    (output,) = made.outputs
    pole = f"{output.link}/{output.relative_to}"
    rates = sk.run(made, f"poles:only={pole}", samples=61).frame("poles")
    places = sk.run(made, NAME, samples=61).frame()
    reversing = places[places["reversal"].str.contains("output", na=False)]
    changes = 0
    for assembly_mode, rows in rates.groupby("assembly_mode"):
        q, *u, size = rows[["q", "ux", "uy", "uz", "velocity_coefficient"]].to_numpy().T
        along = (
            np.sum(np.array(u)[:, 1:] * np.array(u)[:, :-1], axis=0) * size[1:] * size[:-1]
        )
        modes = reversing["assembly_mode"].str.split("+")
        places = reversing["q"][[str(assembly_mode) in each for each in modes]]
        for k in np.flatnonzero(np.isfinite(along)):
            there = places.between(q[k], q[k + 1], inclusive="neither").sum()
            assert there % 2 == int(along[k] < 0.0), (assembly_mode, q[k])
        changes += np.sum(along < 0.0)
    assert changes
