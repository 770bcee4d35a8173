"""Numbers of mechanism files that are read and replaced by their key paths."""

import pytest

from spherekit.errors import FileError
from spherekit.files.number_change import document_of, number_at, number_path, with_numbers
from spherekit.files.toml_document import parse

DOCUMENT = parse('name = "x"\n[links.crank]\narcs = [20.0, 30.0]\n', "x.toml")


def test_a_number_is_read_at_its_path():
    assert number_at(DOCUMENT, ("links", "crank", "arcs", 1)) == 30.0


def test_a_number_in_a_table_that_the_file_leaves_out_is_zero():
    assert number_at(DOCUMENT, ("pairs", "41", "zero")) == 0.0


def test_a_replaced_number_leaves_the_given_document_unchanged():
    path = ("links", "crank", "arcs", 0)
    changed = with_numbers(DOCUMENT, {path: 25.0})
    assert number_at(changed, path) == 25.0
    assert number_at(DOCUMENT, path) == 20.0


@pytest.mark.parametrize("axes", ['"9", "0", "1"', '"9", "1", "0"', '"0", "2", "1"'])
def test_a_size_is_named_by_its_pair_even_if_the_name_is_a_number(axes):
    text = f"[links.3]\naxes = [{axes}]\narcs = [60.0, 30.0]\nangles = [90.0]\n"
    document = parse(text, "x.toml")
    pairs = document.data["links"]["3"]["axes"]
    assert number_path(document, f"links.3.arcs.{pairs[1]}") == ("links", "3", "arcs", 0)
    assert number_path(document, f"links.3.arcs.{pairs[2]}") == ("links", "3", "arcs", 1)
    assert number_path(document, f"links.3.angles.{pairs[2]}") == (
        "links",
        "3",
        "angles",
        0,
    )


def test_only_directions_have_a_longitude_and_a_latitude():
    document = document_of("stephenson")
    with pytest.raises(
        FileError, match=r'links\.3\.arcs: there is no "longitude"'
    ) as fault:
        number_path(document, "links.3.arcs.longitude")
    assert "latitude" not in str(fault.value)
