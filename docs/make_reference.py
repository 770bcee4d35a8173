"""Write docs/reference.md, the keys of all file formats, from their JSON Schemas.

Run it in the root of the repository: ``python docs/make_reference.py``.
"""

import json
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from spherekit.files.schema import schema

PAGE = Path(__file__).parent / "reference.md"

HEADER = """\
# Keys of mechanism, study and synthesis files

See [mechanism files](mechanism-files.md) for an introduction with examples. NAME is a name
that you choose; keys in bold are required."""

Schema = Mapping[str, Any]


def page() -> str:
    """Return the text of the page."""
    lines = [HEADER]
    lines += section(schema("mechanism"), "Mechanism files (`X.toml`)")
    lines += section(schema("study"), "Study files (`X.study.toml`)")
    lines += section(schema("synthesis"), "Synthesis files")
    return "\n".join(lines) + "\n"


def section(whole: Schema, title: str) -> Iterator[str]:
    """Yield the tables of one format, its top level first."""
    yield f"\n## {title}\n"
    yield whole["description"]
    yield ""
    yield from table(whole, whole)
    for path, part in tables(whole, whole, ()):
        kind_of_table = part["properties"].get("kind", {}).get("const")
        with_kind = f' with `kind = "{kind_of_table}"`' if kind_of_table else ""
        yield f"\n### `[{'.'.join(path)}]`{with_kind}\n"
        yield part["description"]
        yield ""
        yield from table(whole, part)


def tables(
    whole: Schema, part: Schema, path: tuple[str, ...]
) -> Iterator[tuple[tuple[str, ...], Schema]]:
    """Yield every table below a part with declared keys, in the order of the schema."""
    for key, value in part["properties"].items():
        inner, where = resolved(whole, value), (*path, key)
        extra = inner.get("additionalProperties")
        if isinstance(extra, Mapping):
            inner, where = resolved(whole, extra), (*where, "NAME")
        if "properties" in inner:
            yield where, inner
            yield from ((where, each) for each in kinds(whole, inner))
            yield from tables(whole, inner, where)


def kinds(whole: Schema, part: Schema) -> Iterator[Schema]:
    """Yield the tables that a part may be, where its kind decides."""
    for rule in part.get("allOf", ()):
        if "$ref" in rule.get("then", {}):
            yield resolved(whole, rule["then"])


def table(whole: Schema, part: Schema) -> Iterator[str]:
    """Yield the rows for the keys of one table."""
    yield "| key | value | meaning |"
    yield "|---|---|---|"
    for key, value in part["properties"].items():
        name = f"**`{key}`**" if key in part.get("required", ()) else f"`{key}`"
        yield f"| {name} | {kind(whole, value)} | {meaning(whole, value)} |"


def kind(whole: Schema, part: Schema) -> str:
    """Return in a few words what stands behind a key."""
    named = str(part.get("$ref", "")).rpartition("/")[2]
    if named in ("name", "path", "angle", "rate"):
        return named
    part = resolved(whole, part)
    if "const" in part:
        return f"`{json.dumps(part['const'])}`"
    if "enum" in part:
        return " or ".join(f'`"{each}"`' for each in part["enum"])
    if isinstance(part["type"], list):
        each = [kind(whole, {**part, "type": one}) for one in part["type"]]
        return " or ".join(each)
    if part["type"] == "array":
        inner = kind(whole, part["items"])
        count = part.get("minItems")
        if count is None or count != part.get("maxItems"):
            return f"[{inner}, ...]"
        return f"[{', '.join([inner] * count)}]"
    if part["type"] == "object":
        return "tables" if isinstance(part.get("additionalProperties"), dict) else "table"
    return {"boolean": "true or false", "string": "text", "integer": "whole number"}.get(
        part["type"], part["type"]
    )


def meaning(whole: Schema, part: Schema) -> str:
    """Return the description nearest to a key, in one line fit for a table."""
    text = part.get("description") or resolved(whole, part)["description"]
    return str(text).replace("|", "\\|")


def resolved(whole: Schema, part: Schema) -> Schema:
    """Return what a part refers to, with its own words kept."""
    if "$ref" not in part:
        return part
    found = whole["$defs"][part["$ref"].rpartition("/")[2]]
    return {**found, **{key: part[key] for key in part if key != "$ref"}}


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")
