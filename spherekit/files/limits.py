"""Which numbers the format allows where a number stands in a file."""

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any, final

from spherekit.files.check import schema, validator
from spherekit.files.document import Document
from spherekit.files.locate import KeyPath

_WORDS = frozenset({"title", "description", "$ref"})
_NUMERIC = _WORDS | {"type", "minimum", "maximum", "exclusiveMinimum"}


@final
@dataclass(frozen=True)
class Limits:
    """Numbers allowed: from `low` to `high`, greater than `above`, if `whole` integers."""

    low: float = -math.inf
    high: float = math.inf
    above: float = -math.inf
    whole: bool = False

    def allow(self, number: float) -> bool:
        """Return whether a number is allowed."""
        inside = self.low <= number <= self.high and number > self.above
        likely = inside and math.isfinite(number)
        return likely and (not self.whole or float(number).is_integer())


NONE = Limits(math.inf, -math.inf)
"""Where rules say more than limits of numbers."""


def limits_of(document: Document, path: KeyPath) -> Limits:
    """Return which numbers the format allows at a path of a document that fits it.

    What else the format asks depends on keys, names and kinds, never on a number beside
    this one, so that with a number that is allowed the document fits the format as before.
    """
    made = Limits()
    for part in _parts(schema(), document.data, path):
        if not _NUMERIC.issuperset(part) or part.get("type") not in ("number", "integer"):
            return NONE
        made = Limits(
            max(made.low, part.get("minimum", -math.inf)),
            min(made.high, part.get("maximum", math.inf)),
            max(made.above, part.get("exclusiveMinimum", -math.inf)),
            made.whole or part["type"] == "integer",
        )
    return made


def _parts(
    part: Mapping[str, Any], value: Any, path: KeyPath
) -> Iterator[Mapping[str, Any]]:
    """Yield what the schema asks of the number at a path of a value."""
    if "$ref" in part:
        name = part["$ref"].removeprefix("#/$defs/")
        yield from _parts(schema()["$defs"][name], value, path)
    for other in part.get("allOf", ()):
        if "if" not in other:
            yield from _parts(other, value, path)
        elif validator().evolve(schema=other["if"]).is_valid(value):
            yield from _parts(other["then"], value, path)
    if not path:
        if not _WORDS.issuperset(part):
            yield part
        return
    step, rest = path[0], path[1:]
    if isinstance(value, Mapping):
        inner = part.get("properties", {}).get(step, part.get("additionalProperties"))
        beneath = value.get(step)
        if beneath is None:
            yield {"required": [step]}
            return
    else:
        inner, beneath = part.get("items"), value[step]
    if isinstance(inner, Mapping):
        yield from _parts(inner, beneath, rest)
