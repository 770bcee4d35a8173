"""Texts that are code somewhere, and files that have them in every field for text."""

import tomllib

from helpers.source_files import ROOT

from spherekit.files.schema import schema
from spherekit.files.toml_text import assignment_text, table_lines

TEXTS = {
    "the end of a comment of C": "before */ int hacked(void) { return 1; } /* after",
    "a comment within one": "before /* within /*/ after */*/ end",
    "a line of C++ goes on": "path C:\\",
    "a trigraph": "what???/\nint hacked; //??/",
    "the end of a script": "a </script><script>window.HACKED = 1</script> b",
    "a script that has no end": "a <!--<script> b --> <!-- <SCRIPT src=x> c",
    "markup": "<img src=x onerror='window.HACKED = 2'> \"><svg/onload=window.HACKED=3>",
    "line ends": "one\ntwo\rthree\r\nfour\fwindow.HACKED = 4;\vfive",
    "separators": "one\u2028window.HACKED = 5;\u2029globalThis.HACKED = 6;\x85seven",
    "an encoding": "coding: utf-7 and coding=latin-1 -*- coding: rot13 -*-",
    "quotes": "\"q\" 'q' `q` ''' \"\"\" + hacked() +",
    "what is put in": "${HACKED} $(id) $css #{x} {0} {name} %s %(x)s \\u0041 \\x41 \\n",
    "LaTeX": "\\input{x} $a_b^c$ 50 % & # ~ ^ \\end{document}",
    "XML": "]]> --> -- --- ---- <!DOCTYPE x> <?php x ?> &amp; &#0; - -",
    "a comment of Julia": '#= a =# $hacked "$(hacked)" #=',
    "a terminal": "\x1b[31mred\x1b]0;title\x07 \x9b2J \x08\x08 \x7f",
    "NUL": "one\0two",
    "from right to left": "a \u202etxet nedderrevo\u202c \u2066isolated b \u200f\u061c",
    "no characters": "\ufeffmark \ufffe \U0000ffff \U000e0041tags",
    "a formula": "=HYPERLINK(1) +1 -1 @x",
    "Markdown": "# h *b* _i_ [x](javascript:1) ![x](http://x.invalid/y) `c` | t > ~~s~~",
    "a list": "1. one\n- two\n+ three\n===\n---\n:::\n```",
    "many letters": "word " * 2000,
    "no space": "*/" * 5000,
    "letters of all kinds": "Ångström, Müller & Søn, 球面机构, שלום, क्षि, 🙂",
}
"""Citations that nobody wrote, by what they do where they are not escaped."""

NAMED, PARSED, FREE, PLACED = "name", "expression", "free", "placed"


def fields(kind="mechanism"):
    """Return every place for text in the schema of a kind of file, with its sort.

    A place is a key path with ``*`` for names. `NAMED` are names, which the format spells,
    `PARSED` expressions, `PLACED` one of some words, and `FREE` all others.
    """
    whole, places = schema(kind), {}

    def visit(node, path, seen):
        if "$ref" in node:
            name = node["$ref"].removeprefix("#/$defs/")
            if name in ("name", "expression"):
                places[path] = NAMED if name == "name" else PARSED
            elif name not in seen:
                visit(whole["$defs"][name], path, (*seen, name))
            return
        if "string" in str(node.get("type", "")):
            one_of = "enum" in node or "const" in node
            places[path] = PLACED if one_of else FREE
        for other in ("anyOf", "oneOf", "allOf"):
            for part in node.get(other, ()):
                visit(part, path, seen)
        for key in ("if", "then", "else"):
            if key in node:
                visit(node[key], path, seen)
        if "propertyNames" in node:
            visit(node["propertyNames"], (*path, "<name>"), seen)
        for key, part in node.get("properties", {}).items():
            visit(part, (*path, key), seen)
        for key in ("additionalProperties", "items"):
            if isinstance(node.get(key), dict):
                visit(node[key], (*path, "*"), seen)
        is_open = node.get("type") == "object" and "additionalProperties" not in node
        if is_open and not node.get("properties"):
            places[path] = FREE

    visit(whole, (), ())
    return places


def free_fields():
    """Return the key paths of a mechanism file that hold any text."""
    return [path for path, sort in fields().items() if sort == FREE]


def hostile_file(text, name="four_bar"):
    """Return a shipped mechanism's file with a text in every field that takes any text."""
    data = tomllib.loads((ROOT / f"mechanisms/{name}.toml").read_text("utf-8"))
    for *tables_of, key in free_fields():
        assert "*" not in tables_of, f"{tables_of}: no rule says where this text is put"
        place = data
        for part in tables_of:
            place = place.setdefault(part, {})
        place[key] = {"text": text, text: [text]} if key == "user" else text
    letters = " ".join(text.split())  # comments of TOML have no control characters
    comment = "".join(x for x in letters if ord(x) >= 32 and ord(x) != 127)
    written = [f"# {comment}"]
    for key, value in data.items():
        if isinstance(value, dict):
            written += table_lines((key,), value)
        else:
            written.append(assignment_text(key, value))
    return "\n".join([*written, ""])
