"""Shipped mechanisms with other loads or other numbers."""

from dataclasses import replace

import spherekit as sk
from spherekit.files.mechanism_reader import read
from spherekit.files.number_change import document_of, number_path, with_numbers


def load_without_loads(name):
    """Return a shipped mechanism without its masses and loads."""
    return replace(sk.load(name), masses=(), loads=())


def with_file_numbers(mechanism, numbers_by_key):
    """Return the mechanism of a file in which some numbers are replaced.

    Parameters
    ----------
    mechanism
        Name, path or mechanism that was read from a file.
    numbers_by_key
        New numbers by their keys (`"links.coupler.arcs[0]"`), in the units of the file.
    """
    document = document_of(mechanism)
    numbers = {number_path(document, key): n for key, n in numbers_by_key.items()}
    return read(with_numbers(document, numbers))


def four_bar_with_springs(*pairs):
    """Return the shipped four-bar with a torsion spring at each of the named pairs.

    The torque is proportional to the total angle, so it depends on the number of turns.
    """
    springs = [sk.PairTorque(f"at_{p}", p, f"-0.3*theta_{p}") for p in pairs]
    mechanism = sk.load("four_bar")
    return replace(mechanism, loads=(*mechanism.loads, *springs))
