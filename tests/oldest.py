"""The least versions that the metadata allow, as constraints for pip."""

import re
import tomllib
from pathlib import Path

METADATA = Path(__file__).parent.parent / "pyproject.toml"


def least():
    """Return the least version of each dependency that has one, of all extras too."""
    project = tomllib.loads(METADATA.read_text(encoding="utf-8"))["project"]
    extras = project["optional-dependencies"]
    wanted = [
        *project["dependencies"],
        *(item for items in extras.values() for item in items),
    ]
    found = (re.match(r"([\w.-]+)>=([\d.]+)", item) for item in wanted)
    return {match[1]: match[2] for match in found if match}


if __name__ == "__main__":
    for name, version in least().items():
        print(f"{name}=={version}")
