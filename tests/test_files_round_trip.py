"""Writing a mechanism and reading it back gives exactly the same mechanism."""

import datetime
import errno
import math
import os
import stat
import sys
import tomllib

import numpy as np
import pytest
from helpers.refusals import TABLES, check_call

import spherekit as sk
from spherekit.errors import OutputError
from spherekit.files.angle_units import to_radians, to_text, unit_vector
from spherekit.files.mechanism_reader import load, loads
from spherekit.files.mechanism_writer import (
    _describe_change,
    canonical_text,
    dump,
    dumps,
    mechanism_hash,
)
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
from spherekit.storage.atomic_write import (
    check_file,
    check_folder,
    check_made_by_spherekit,
    make_folder,
    write_text,
)
from spherekit.storage.file_lock import acquire_lock

UNITS = ("deg", "rad")
USER_DATA = {
    "note": 'say "x"\\ \t\n\x01\x7f é 😀',
    "a key": {"deep er": {"x": [1, 2.5, True, {"y": "z", "w": []}]}},
    "empty": {},
    "day": datetime.date(2026, 11, 21),
    "moment": datetime.datetime(2026, 11, 21, 4, 5, 6, 789, tzinfo=datetime.UTC),
    "clock": datetime.time(4, 5),
    "rates": [1e-300, -0.0, 1e22, 5e-324, math.inf],
}
"""Free data of a user with every type of TOML, control characters and extreme numbers."""


def random_pairs(random, link_count):
    """Return revolute pairs of a closed chain of links and a chord across it.

    Links are L0, L1, ...; the order of pairs and of both links of a pair varies.
    """
    ends = [(k, (k + 1) % link_count) for k in range(link_count)]
    ends.append((0, link_count // 2))
    pairs = []
    for k, (a, b) in enumerate(ends):
        links = (f"L{a}", f"L{b}") if k % 2 else (f"L{b}", f"L{a}")
        pairs.append(Pair(f"p{k}_{a}{b}", "R", links))
    return tuple(pairs[k] for k in random.permutation(len(pairs)))


def random_profile(random, kind):
    """Return a contact profile of a kind with random sizes (rad) and axes."""
    centre = random_axis(random)
    coefficients = tuple(map(float, random.uniform(-1, 1, 3)))
    if kind == "circle":
        return Profile(kind, centre, radius=float(random.uniform(0.1, 3)))
    if kind == "great_circle":
        return Profile(kind, centre)
    if kind == "fourier":
        return Profile(kind, centre, cosines=coefficients, sines=coefficients[:2])
    points = tuple(random_axis(random) for _ in range(7))
    return Profile(kind, points=points, closed=bool(random.integers(2)))


def random_axis(random):
    """Return a random unit vector as floats."""
    xyz = random.normal(size=3)
    return tuple(map(float, xyz / np.linalg.norm(xyz)))


def random_masses(random, links):
    """Return a mass for every link but the ground: four unit masses at random points.

    The tensor is the sum of |r|^2 I - r r^T over the points. The first mass has no centre.
    """
    masses = []
    for link in links[1:]:
        points = random.normal(size=(4, 3)) * 10.0 ** random.integers(-6, 6)
        inertia = np.sum(points**2) * np.eye(3) - points.T @ points
        # The mean with the transpose is exactly symmetric.
        tensor = tuple(tuple(map(float, row)) for row in (inertia + inertia.T) / 2)
        centre = tuple(map(float, np.mean(points, axis=0)))
        masses.append(Mass(link, tensor, 4.0, centre) if masses else Mass(link, tensor))
    return tuple(masses)


def random_loads(random, links, pair, random_angle):
    """Return one load of each kind but gravity, with random numbers.

    They act at a pair and at the first two links of `links`. `random_angle` is a function
    that returns a random angle (rad). Tests write the loads to a file and read them again.
    """
    a, b = map(float, random.uniform(0, 1, 2))  # numbers for fields of any unit
    components = ("1", f"theta_{pair}", "0.5*t")

    def random_speed():
        """Return a random rate (rad/s), which must not be 0."""
        return abs(random_angle()) + 1e-9

    return (
        sk.PairTorque("torque", pair, f"-2*theta_{pair}"),
        # The components are along the axes of the link.
        sk.PointForce("force", links[0], random_axis(random), components, axes="link"),
        sk.Moment("moment", links[1], components),
        sk.Spring("spring", pair, stiffness=a, rest=random_angle()),
        sk.Damper("damper", pair, damping=b),
        sk.Friction("friction", pair, torque=a, viscous=b, speed=random_speed()),
        sk.Bearings(
            "held",
            pair,
            positions=(a + 0.1,),
            radius=b,
            coefficient=a,
            speed=random_speed(),
        ),
        sk.TorqueTable(
            "table", pair, times=(0.0, a, a + 1), torques=(a, b, a), periodic=True
        ),
    )


def random_mechanism(seed):
    """Return a random mechanism with any content that a file can have.

    Tests write it and read it again. It need not be able to move. Odd seeds state joint
    axes in a pose and have a contact; even seeds state arcs and angles on links. The
    magnitude of angles is between 1e-9 and 10.
    """
    random = np.random.default_rng(seed)
    link_count = int(random.integers(3, 7))
    links = tuple(f"L{k}" for k in range(link_count))
    pairs = random_pairs(random, link_count)
    scale = 10.0 ** random.integers(-9, 1)

    def random_angle():
        return float(random.uniform(-2 * math.pi, 2 * math.pi) * scale)

    if seed % 2:
        kinds = random.choice(["circle", "great_circle", "fourier", "points"], 2)
        profiles = tuple(random_profile(random, str(kind)) for kind in kinds)
        axes = {pair.name: random_axis(random) for pair in pairs}
        values = {pair.name: random_angle() for pair in pairs[1:]}
        pairs = (*pairs, Pair("contact", "Cr", (links[1], links[0]), profiles))
        geometry = PoseGeometry(axes, values)
    else:
        sizes = {}
        for link in links:
            pair_names = tuple(pair.name for pair in pairs if link in pair.links)
            arcs = tuple(random_angle() for _ in pair_names[1:])
            # Arcs below 0 or above pi are only allowed if the link says so.
            is_signed = not all(0.0 <= arc <= math.pi for arc in arcs)
            angles = tuple(random_angle() for _ in pair_names[2:])
            sizes[link] = LinkSizes(pair_names, arcs, angles, signed=is_signed)
        # The first pair has a zero position of its own.
        geometry = SizeGeometry(sizes, zeros={pairs[0].name: random_angle()})
    input_pair = pairs[0].name
    return sk.Mechanism(
        name=f"random_{seed}",
        ground=links[0],
        links=links,
        pairs=pairs,
        geometry=geometry,
        inputs=(Input(input_pair, random_angle(), random_angle()),),
        outputs=(Output("out", links[2], links[1]),),
        masses=random_masses(random, links),
        loads=random_loads(random, links, input_pair, random_angle),
        joint_limits=(JointLimit(input_pair, *sorted((random_angle(), random_angle()))),),
        source=Source("A, 'B \"C\"', 2024", "nothing\nmuch") if seed % 3 else None,
        user=USER_DATA if seed % 5 == 0 else {},
        description='Its "links" turn.\nAn example.' if seed % 2 else "",
    )


SEEDS = [*range(10), *(pytest.param(x, marks=pytest.mark.slow) for x in range(10, 40))]


@pytest.mark.many
@pytest.mark.parametrize("unit", UNITS)
@pytest.mark.parametrize("seed", SEEDS)
def test_random_mechanisms_read_back_exactly_as_written(seed, unit, tmp_path):
    """Every float, the order of links and the unit of angles survive writing and reading.

    Writing the mechanism that was read gives the same text again.
    """
    mechanism = random_mechanism(seed)
    path = tmp_path / "written.toml"
    dump(mechanism, path, unit)
    from_file = load(path)
    assert from_file == mechanism
    assert from_file.links == mechanism.links
    assert from_file.description == mechanism.description
    assert dumps(from_file, unit) == path.read_text(encoding="utf-8")
    assert tomllib.loads(dumps(mechanism, unit))["angle_unit"] == unit


@pytest.mark.slow
def test_degrees_of_a_file_give_back_every_angle_in_radians_exactly():
    """Every angle in radians is written in degrees so that it is read back exactly.

    Random angles of all magnitudes and both neighbouring floats are tried. Up to 24 digits
    are needed, because not every radian has a float64 in degrees that converts back to it.
    """
    random = np.random.default_rng(7)
    angles = [*random.uniform(-13, 13, 2_500), *10.0 ** random.uniform(-300, 1, 1_000)]
    angles += [5e-324, 1e-310, 2.2250738585072014e-308, -5e-324]  # denormal and smallest
    most_digits = 0
    for angle in map(float, angles):
        below = math.nextafter(angle, 0)
        above = math.nextafter(angle, 99)
        for radians in (angle, below, above):
            text = to_text(radians, "deg")
            assert to_radians(LiteralNumber(text), "deg") == radians
            assert tomllib.loads(f"a = {text}")["a"] == float(text)
            digits = text.split("e")[0].strip("-").replace(".", "")
            most_digits = max(most_digits, len(digits))
    assert most_digits <= 24


def test_degrees_with_one_decimal_are_written_with_one_decimal():
    """All tenths of a degree over two turns to both sides; 0.0 also stands for -0.0."""
    for tenths in range(-7200, 7201):
        degrees = tenths / 10
        assert to_text(math.radians(degrees), "deg") in (repr(degrees), "0.0")
    assert to_text(math.pi, "deg") == "180.0"
    assert to_text(math.radians(1e-9), "deg") == "1e-9"
    assert to_text(5e-324, "rad") == "5e-324"


def test_degrees_are_read_as_math_radians_converts_them():
    degrees = LiteralNumber("60.10000000000000000000000")
    assert to_radians(degrees, "deg") == math.radians(60.1)
    assert to_radians(45, "deg") == math.pi / 4


def test_normalising_a_unit_vector_again_changes_no_bit():
    random = np.random.default_rng(3)
    for xyz in random.normal(size=(2000, 3)):
        nearly_unit = xyz / np.linalg.norm(xyz) * random.uniform(0.9995, 1.0005)
        once = unit_vector(tuple(map(float, nearly_unit)))
        assert abs(math.hypot(*once) - 1) < 4e-16
        assert unit_vector(once) == once


def test_written_keys_have_the_order_of_the_schema():
    """This holds for the tables of a file and for the keys of a contact pair."""
    keys = list(tomllib.loads(dumps(random_mechanism(5))))
    assert keys == [key for key in schema()["properties"] if key in keys]
    contact = random_mechanism(1).pairs[-1].name
    contact_keys = list(tomllib.loads(dumps(random_mechanism(1)))["pairs"][contact])
    schema_keys = list(schema()["$defs"]["pair"]["properties"])
    assert contact_keys == sorted(contact_keys, key=schema_keys.index)


def test_written_text_has_short_lines_and_an_empty_line_before_each_table():
    text = dumps(random_mechanism(2))
    assert max(map(len, text.splitlines())) <= 100
    assert text.startswith('format = 1\nname = "random_2"\nangle_unit = "deg"\n')
    assert "\n\n[source]\n" in text
    assert "\n\n\n" not in text


def small_mechanism(**changes):
    """Return a mechanism of two links and one pair with some fields changed."""
    fields = {
        "name": "small",
        "ground": "1",
        "links": ("1", "2"),
        "pairs": (Pair("a", "R", ("1", "2")),),
        "geometry": PoseGeometry({"a": (0.0, 0.0, 1.0)}),
    }
    return sk.Mechanism(**{**fields, **changes})


@pytest.mark.parametrize("call", TABLES["writing"])
def test_writing_refuses_content_that_the_format_cannot_hold(call):
    check_call(call, globals(), TABLES["writing"][call])


def test_paths_that_cannot_be_written_are_refused_with_the_reason(tmp_path):
    (tmp_path / "file").write_text("x")
    for path, words in (
        (tmp_path / "none" / "x.toml", "the folder does not exist"),
        (tmp_path / "file" / "x.toml", "a part of the path is a file"),
        (tmp_path, "is a folder"),
        (tmp_path / "x\0.toml", "null"),
    ):
        with pytest.raises(OutputError, match=words):
            dump(small_mechanism(), path)
    assert [path.name for path in tmp_path.iterdir()] == ["file"]


def test_folders_are_not_made_in_place_of_a_file_or_below_it(tmp_path):
    (tmp_path / "file").write_text("x")
    with pytest.raises(OutputError, match="is a file, not a folder"):
        make_folder(tmp_path / "file")
    with pytest.raises(OutputError, match="a part of the path is a file"):
        make_folder(tmp_path / "file" / "inner")
    assert [path.name for path in tmp_path.iterdir()] == ["file"]


def test_a_folder_may_be_made_twice(tmp_path):
    assert make_folder(tmp_path / "a" / "b") == make_folder(tmp_path / "a" / "b")


def test_user_data_may_hold_nan_and_tuples():
    assert math.isnan(loads(dumps(small_mechanism(user={"x": math.nan}))).user["x"])
    assert loads(dumps(small_mechanism(user={"x": (1, 2)}))).user == {"x": [1, 2]}


def test_a_mechanism_with_any_text_in_its_user_data_has_a_hash():
    hashes = {mechanism_hash(small_mechanism(user={"x": x})) for x in ("", "\ud800", "é")}
    assert len(hashes) == 3


def test_canonical_text_exists_for_a_mechanism_that_has_no_file_in_radians():
    """An input range of 20 rad is refused in a file in radians, but not in degrees."""
    wide = small_mechanism(inputs=(Input("a", 0.0, 20.0),))
    assert canonical_text(wide, "rad") != canonical_text(small_mechanism(), "rad")
    assert canonical_text(small_mechanism(), "deg") == dumps(small_mechanism(), "deg")
    assert loads(dumps(wide, "deg")) == wide


@pytest.mark.parametrize(
    ("function", "code", "words"),
    [
        ("fsync", errno.ENOSPC, "the disk is full"),
        ("open", errno.EACCES, "the folder is not writable"),
        ("replace", errno.EROFS, "read-only"),
    ],
)
def test_failed_writing_leaves_the_old_file(tmp_path, monkeypatch, function, code, words):
    """If writing a file fails, the old file stays and no temporary file is left.

    A function of `os` is replaced by one that fails with an error code. The message says
    why.
    """
    path = tmp_path / "x.toml"
    path.write_text("old")
    mechanism = small_mechanism()

    def fail(*_):
        raise OSError(code, os.strerror(code))

    monkeypatch.setattr(os, function, fail)
    with pytest.raises(OutputError, match=words):
        dump(mechanism, path)
    monkeypatch.undo()
    assert path.read_text() == "old"
    assert list(tmp_path.iterdir()) == [path]


def test_writing_to_a_symbolic_link_replaces_the_file_that_it_points_to(tmp_path):
    """The link stays a link, and the file has the permissions of a new file."""
    path = tmp_path / "x.toml"
    link = tmp_path / "link.toml"
    dump(small_mechanism(), path)
    link.symlink_to(path)
    dump(small_mechanism(name="other"), link)
    assert link.is_symlink()
    assert load(path).name == "other"
    mask = os.umask(0)
    os.umask(mask)
    assert stat.S_IMODE(path.stat().st_mode) == 0o666 & ~mask


def test_a_file_with_a_long_name_of_any_letters_is_written(tmp_path):
    """The name has 252 bytes, which are 84 letters of three bytes; the limit is 255."""
    path = tmp_path / ("\N{HIRAGANA LETTER A}" * 84)
    write_text(path, "x")
    assert path.read_text() == "x"
    assert list(tmp_path.iterdir()) == [path]


def test_checks_refuse_links_to_places_where_nothing_can_be_written(tmp_path):
    """A check before a computation refuses what cannot be written after it."""
    to_nothing = tmp_path / "to_nothing"
    to_nothing.symlink_to(tmp_path / "missing" / "file")
    to_itself = tmp_path / "to_itself"
    to_itself.symlink_to(to_itself)
    for write in (lambda path: write_text(path, "x"), check_file):
        with pytest.raises(OutputError, match="the folder does not exist"):
            write(to_nothing)
    for link in (to_nothing, to_itself):
        for create in (make_folder, check_folder):
            with pytest.raises(OutputError, match="is a file, not a folder"):
                create(link)


@pytest.mark.skipif(sys.version_info >= (3, 13), reason="such links are replaced")
def test_a_link_to_itself_is_refused_as_a_file(tmp_path):
    link = tmp_path / "link"
    link.symlink_to(link)
    for write in (lambda path: write_text(path, "x"), check_file):
        with pytest.raises(OutputError, match="cannot be written: .*symbolic links"):
            write(link)


@pytest.mark.parametrize("place", ["beginning", "end"])
def test_the_mark_is_found_at_both_ends_of_a_large_file(tmp_path, place, monkeypatch):
    """PDF files have the mark at their end."""
    monkeypatch.setattr("spherekit.storage.atomic_write.MAX_MARK_OFFSET_BYTES", 100)
    path = tmp_path / "large.pdf"
    path.write_bytes(b"mark" + bytes(500) if place == "beginning" else bytes(500) + b"mark")
    check_made_by_spherekit(path, b"mark")
    with pytest.raises(OutputError, match="no command of spherekit"):
        check_made_by_spherekit(path, b"another mark")


def test_a_lock_that_cannot_be_created_is_refused_with_a_reason(tmp_path):
    with pytest.raises(OutputError, match="the name is too long"):
        acquire_lock(tmp_path / ("a" * 300) / "lock")


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no pipes with names")
def test_writing_does_not_replace_a_pipe(tmp_path):
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    for write in (lambda path: write_text(path, "x"), check_file):
        with pytest.raises(OutputError, match="is a device or a pipe; give the name"):
            write(pipe)
    assert pipe.is_fifo()


def test_a_line_that_only_the_second_text_has_is_called_added():
    """A table ends in the first text where the second text has one more key."""
    assert _describe_change("", "closed = true") == "closed = true would be added"
    assert _describe_change("radius = 20.0", "") == "radius = 20.0 would be lost"
    change = _describe_change("radius = 20.0", "radius = 10.0")
    assert change == "radius = 20.0 would become 10.0"
