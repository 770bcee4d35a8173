"""The least versions that the metadata allow are those that CONTRIBUTING.md tests with."""

import tomllib
from importlib.metadata import PackageNotFoundError, version

from oldest import METADATA, least


def numbers(text):
    return tuple(int(part) for part in text.split(".")[:3] if part.isdigit())


def test_every_dependency_has_a_least_version_and_no_less_is_installed():
    project = tomllib.loads(METADATA.read_text(encoding="utf-8"))["project"]
    assert project["dependencies"]
    bounds = least()
    for item in project["dependencies"]:
        name = item.partition(">=")[0]
        assert numbers(version(name)) >= numbers(bounds[name]), item
    for name, bound in bounds.items():
        try:
            assert numbers(version(name)) >= numbers(bound), name
        except PackageNotFoundError:
            continue  # an extra that is not installed
