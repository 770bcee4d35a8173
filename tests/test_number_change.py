"""Numbers of mechanism files that are read and replaced by their key paths."""

from spherekit.files.number_change import number_at, with_numbers
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
