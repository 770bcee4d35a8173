"""Writing a mechanism and reading it back gives exactly the same mechanism."""

import datetime
import errno
import math
import os
import stat
import tomllib

import numpy as np
import pytest
from helpers.refusals import TABLES, check_call

import spherekit as sk
from spherekit.errors import OutputError
from spherekit.files.angle_units import to_radians, to_text, unit_vector
from spherekit.files.mechanism_reader import load, loads
from spherekit.files.mechanism_writer import canonical_text, dump, dumps
from spherekit.files.schema import schema
from spherekit.files.toml_document import LiteralNumber
from spherekit.mechanism.elements import (
    Input,
    LinkSizes,
    Output,
    Pair,
    PoseGeometry,
    Profile,
    SizeGeometry,
    Source,
)
from spherekit.mechanism.inertia import Mass
from spherekit.mechanism.load_kinds import JointLimit
from spherekit.storage.atomic_write import check_file, make_folder, write_text

UNITS = ("deg", "rad")
USER = {
    "note": 'say "x"\\ \t\n\x01\x7f é 😀',
    "a key": {"deep er": {"x": [1, 2.5, True, {"y": "z", "w": []}]}},
    "empty": {},
    "day": datetime.date(2026, 11, 21),
    "moment": datetime.datetime(2026, 11, 21, 4, 5, 6, 789, tzinfo=datetime.UTC),
    "clock": datetime.time(4, 5),
    "rates": [1e-300, -0.0, 1e22, 5e-324, math.inf],
}


def random_pairs(random, links):
    """Return R pairs along a closed chain with one chord more, in random order."""
    ends = [(k, (k + 1) % links) for k in range(links)] + [(0, links // 2)]
    pairs = [
        Pair(f"p{k}_{a}{b}", "R", (f"L{a}", f"L{b}") if k % 2 else (f"L{b}", f"L{a}"))
        for k, (a, b) in enumerate(ends)
    ]
    return tuple(pairs[k] for k in random.permutation(len(pairs)))


def random_profile(random, kind):
    """Return a random profile of a kind."""
    centre = random_axis(random)
    angles = tuple(map(float, random.uniform(-1, 1, 3)))
    if kind == "circle":
        return Profile(kind, centre, radius=float(random.uniform(0.1, 3)))
    if kind == "great_circle":
        return Profile(kind, centre)
    if kind == "fourier":
        return Profile(kind, centre, cosines=angles, sines=angles[:2])
    points = tuple(random_axis(random) for _ in range(7))
    return Profile(kind, points=points, closed=bool(random.integers(2)))


def random_axis(random):
    """Return a random unit vector as floats."""
    xyz = random.normal(size=3)
    return tuple(map(float, xyz / np.linalg.norm(xyz)))


def random_masses(random, links):
    """Return masses of clouds of points, the first without a centre."""
    found = []
    for link in links[1:]:
        points = random.normal(size=(4, 3)) * 10.0 ** random.integers(-6, 6)
        inertia = np.sum(points**2) * np.eye(3) - points.T @ points
        tensor = tuple(tuple(map(float, row)) for row in (inertia + inertia.T) / 2)
        centre = tuple(map(float, np.mean(points, axis=0)))
        found.append(Mass(link, tensor, 4.0, centre) if found else Mass(link, tensor))
    return tuple(found)


def random_loads(random, links, pair, angle):
    """Return one load of each kind but gravity."""
    one, other = map(float, random.uniform(0, 1, 2))
    forces = ("1", f"theta_{pair}", "0.5*t")
    return (
        sk.PairTorque("torque", pair, f"-2*theta_{pair}"),
        sk.PointForce("force", links[0], random_axis(random), forces, "link"),
        sk.Moment("moment", links[1], forces),
        sk.Spring("spring", pair, one, angle()),
        sk.Damper("damper", pair, other),
        sk.Friction("friction", pair, one, other, abs(angle()) + 1e-9),
        sk.Bearings("held", pair, (one + 0.1,), other, one, abs(angle()) + 1e-9),
        sk.TorqueTable("table", pair, (0.0, one, one + 1), (one, other, one), True),
    )


def random_mechanism(seed):
    """Return a random mechanism: any legal content, not one that moves."""
    random = np.random.default_rng(seed)
    count = int(random.integers(3, 7))
    links = tuple(f"L{k}" for k in range(count))
    pairs = random_pairs(random, count)
    scale = 10.0 ** random.integers(-9, 1)

    def angle():
        return float(random.uniform(-2 * math.pi, 2 * math.pi) * scale)

    if seed % 2:
        contact = random.choice(["circle", "great_circle", "fourier", "points"], 2)
        profiles = tuple(random_profile(random, str(kind)) for kind in contact)
        axes = {pair.name: random_axis(random) for pair in pairs}
        values = {pair.name: angle() for pair in pairs[1:]}
        pairs = (*pairs, Pair("contact", "Cr", (links[1], links[0]), profiles))
        geometry = PoseGeometry(axes, values)
    else:
        sizes = {}
        for link in links:
            on_link = tuple(pair.name for pair in pairs if link in pair.links)
            arcs = tuple(angle() for _ in on_link[1:])
            signed = not all(0.0 <= arc <= math.pi for arc in arcs)
            angles = tuple(angle() for _ in on_link[2:])
            sizes[link] = LinkSizes(on_link, arcs, angles, signed=signed)
        geometry = SizeGeometry(sizes, {pairs[0].name: angle()})
    first = pairs[0].name
    return sk.Mechanism(
        name=f"random_{seed}",
        ground=links[0],
        links=links,
        pairs=pairs,
        geometry=geometry,
        inputs=(Input(first, angle(), angle()),),
        outputs=(Output("out", links[2], links[1]),),
        masses=random_masses(random, links),
        loads=random_loads(random, links, first, angle),
        joint_limits=(JointLimit(first, *sorted((angle(), angle()))),),
        source=Source("A, 'B \"C\"', 2024", "nothing\nmuch") if seed % 3 else None,
        user=USER if seed % 5 == 0 else {},
    )


SEEDS = [*range(10), *(pytest.param(x, marks=pytest.mark.slow) for x in range(10, 40))]


@pytest.mark.many
@pytest.mark.parametrize("unit", UNITS)
@pytest.mark.parametrize("seed", SEEDS)
def test_random_mechanisms(seed, unit, tmp_path):
    mechanism = random_mechanism(seed)
    path = tmp_path / "written.toml"
    dump(mechanism, path, unit)
    again = load(path)
    assert again == mechanism and again.links == mechanism.links
    assert dumps(again, unit) == path.read_text(encoding="utf-8")
    assert tomllib.loads(dumps(mechanism, unit))["angle_unit"] == unit


def test_every_radian_can_be_written_in_degrees():
    random = np.random.default_rng(7)
    angles = [*random.uniform(-13, 13, 2_500), *10.0 ** random.uniform(-300, 1, 1_000)]
    angles += [5e-324, 1e-310, 2.2250738585072014e-308, -5e-324]
    longest = 0
    for angle in map(float, angles):
        for near in (angle, math.nextafter(angle, 0), math.nextafter(angle, 99)):
            text = to_text(near, "deg")
            assert to_radians(LiteralNumber(text), "deg") == near
            assert tomllib.loads(f"a = {text}")["a"] == float(text)
            longest = max(longest, len(text.split("e")[0].strip("-").replace(".", "")))
    assert longest <= 24


def test_short_degrees_stay_short_and_mean_what_programs_compute():
    for tenths in range(-7200, 7201):
        degrees = tenths / 10
        assert to_text(math.radians(degrees), "deg") in (repr(degrees), "0.0")
    assert to_radians(LiteralNumber("60.10000000000000000000000"), "deg") == math.radians(
        60.1
    )
    assert to_radians(45, "deg") == math.pi / 4 and to_text(math.pi, "deg") == "180.0"
    assert to_text(math.radians(1e-9), "deg") == "1e-9"
    assert to_text(5e-324, "rad") == "5e-324"


def test_unit_vectors_are_left_alone_once_normalised():
    random = np.random.default_rng(3)
    for xyz in random.normal(size=(2000, 3)):
        nearly = xyz / np.linalg.norm(xyz) * random.uniform(0.9995, 1.0005)
        once = unit_vector(tuple(map(float, nearly)))
        assert abs(math.hypot(*once) - 1) < 4e-16 and unit_vector(once) == once


def test_a_written_file_is_readable_by_people_in_the_order_of_the_schema():
    keys = list(tomllib.loads(dumps(random_mechanism(5))))
    assert keys == [key for key in schema()["properties"] if key in keys]
    pair = random_mechanism(1).pairs[-1].name
    written = tomllib.loads(dumps(random_mechanism(1)))["pairs"][pair]
    order = list(schema()["$defs"]["pair"]["properties"])
    assert list(written) == sorted(written, key=order.index)
    text = dumps(random_mechanism(2))
    assert max(map(len, text.splitlines())) <= 100
    assert text.startswith('format = 1\nname = "random_2"\nangle_unit = "deg"\n')
    assert "\n\n[source]\n" in text and "\n\n\n" not in text


def square(**changes):
    """Return a small mechanism with some fields changed."""
    fields = {
        "name": "small",
        "ground": "1",
        "links": ("1", "2"),
        "pairs": (Pair("a", "R", ("1", "2")),),
        "geometry": PoseGeometry({"a": (0.0, 0.0, 1.0)}),
    }
    return sk.Mechanism(**{**fields, **changes})


@pytest.mark.parametrize("call", TABLES["writing"])
def test_what_the_format_cannot_hold_is_refused(call):
    check_call(call, globals(), TABLES["writing"][call])


def test_places_that_cannot_be_written(tmp_path):
    (tmp_path / "file").write_text("x")
    for path, words in (
        (tmp_path / "none" / "x.toml", "the folder does not exist"),
        (tmp_path / "file" / "x.toml", "a part of the path is a file"),
        (tmp_path, "is a folder"),
        (tmp_path / "x\0.toml", "null"),
    ):
        with pytest.raises(OutputError, match=words):
            dump(square(), path)
    with pytest.raises(OutputError, match="is a file, not a folder"):
        make_folder(tmp_path / "file")
    with pytest.raises(OutputError, match="a part of the path is a file"):
        make_folder(tmp_path / "file" / "inner")
    assert [each.name for each in tmp_path.iterdir()] == ["file"]
    assert make_folder(tmp_path / "a" / "b") == make_folder(tmp_path / "a" / "b")


def test_the_canonical_text_exists_also_where_no_file_does():
    assert math.isnan(loads(dumps(square(user={"x": math.nan}))).user["x"])
    assert loads(dumps(square(user={"x": (1, 2)}))).user == {"x": [1, 2]}
    far = square(inputs=(Input("a", 0.0, 20.0),))
    assert canonical_text(far, "rad") != canonical_text(square(), "rad")
    assert canonical_text(square(), "deg") == dumps(square(), "deg")
    assert loads(dumps(far, "deg")) == far


@pytest.mark.parametrize(
    ("function", "code", "words"),
    [
        ("fsync", errno.ENOSPC, "the disk is full"),
        ("open", errno.EACCES, "the folder is not writable"),
        ("replace", errno.EROFS, "read-only"),
    ],
)
def test_failed_writing_leaves_the_old_file(tmp_path, monkeypatch, function, code, words):
    path = tmp_path / "x.toml"
    path.write_text("old")

    def failing(*_):
        raise OSError(code, os.strerror(code))

    text = square()
    monkeypatch.setattr(os, function, failing)
    with pytest.raises(OutputError, match=words):
        dump(text, path)
    monkeypatch.undo()
    assert path.read_text() == "old" and list(tmp_path.iterdir()) == [path]


def test_links_to_files_and_permissions_stay(tmp_path):
    path, link = tmp_path / "x.toml", tmp_path / "link.toml"
    dump(square(), path)
    link.symlink_to(path)
    dump(square(name="other"), link)
    assert link.is_symlink()
    assert load(path).name == "other"
    mask = os.umask(0)
    os.umask(mask)
    assert stat.S_IMODE(path.stat().st_mode) == 0o666 & ~mask


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no pipes with names")
def test_nothing_takes_the_place_of_a_pipe_or_a_device(tmp_path):
    os.mkfifo(tmp_path / "pipe")
    for write in (lambda path: write_text(path, "x"), check_file):
        with pytest.raises(OutputError, match="is a device or a pipe; give the name"):
            write(tmp_path / "pipe")
    assert (tmp_path / "pipe").is_fifo()
