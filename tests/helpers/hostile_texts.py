"""Texts that some language reads as code, and files with such a text in all text fields."""

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
"""Hostile texts. The key says what a text does in a language in which it is not escaped."""

NAME = "name"
"""Sort of a field for names, which have a restricted spelling."""
EXPRESSION = "expression"
"""Sort of a field for mathematical expressions, which are parsed."""
CHOICE = "choice"
"""Sort of a field for one of several given words."""
FREE = "free"
"""Sort of a field for any text."""


def find_text_fields(kind="mechanism"):
    """Return every field for text in the JSON schema of a kind of file, with its sort.

    Parameters
    ----------
    kind
        `"mechanism"` or another kind of file that has a schema.

    Returns
    -------
    dict
        Sort by key path, where ``*`` stands for any name. The sort is `NAME` for names
        with a restricted spelling, `EXPRESSION` for mathematical expressions, `CHOICE` for
        one of several given words, and `FREE` for any text.
    """
    whole_schema = schema(kind)
    sorts = {}

    def visit(node, path, visited_definitions):
        """Add the fields for text in a part of a JSON schema to `sorts`, by their paths.

        The sort of a field is `NAME`, `EXPRESSION` (a formula), `CHOICE` (one of several
        words) or `FREE` (any text).

        Parameters
        ----------
        node
            The part of the schema.
        path
            Keys that lead to the values that this part declares. ``*`` stands for any key
            or index. ``<name>`` at the end stands for a key itself: in a table whose keys
            are free, each key is a text too.
        visited_definitions
            Names of the definitions that contain this part. A definition may refer to
            itself, and is then not visited again.
        """
        # `false` stands for a key that is not allowed here.
        if node is False:
            return
        if "$ref" in node:
            name = node["$ref"].removeprefix("#/$defs/")
            if name == "name":
                sorts[path] = NAME
            elif name == "expression":
                sorts[path] = EXPRESSION
            elif name not in visited_definitions:
                definition = whole_schema["$defs"][name]
                visit(definition, path, (*visited_definitions, name))
            return
        # The type is a word or a list of words; both have "string" in them for a text.
        if "string" in str(node.get("type", "")):
            is_restricted = "enum" in node or "const" in node
            sorts[path] = CHOICE if is_restricted else FREE
        for combination in ("anyOf", "oneOf", "allOf"):
            for part in node.get(combination, ()):
                visit(part, path, visited_definitions)
        for key in ("if", "then", "else"):
            if key in node:
                visit(node[key], path, visited_definitions)
        if "propertyNames" in node:
            # This part declares the free keys of a table, not their values.
            visit(node["propertyNames"], (*path, "<name>"), visited_definitions)
        for key, part in node.get("properties", {}).items():
            visit(part, (*path, key), visited_definitions)
        for key in ("additionalProperties", "items"):
            if isinstance(node.get(key), dict):
                visit(node[key], (*path, "*"), visited_definitions)
        # A table for which the schema declares no keys at all may contain any texts.
        is_table = node.get("type") == "object"
        declares_keys = node.get("properties") or "additionalProperties" in node
        if is_table and not declares_keys:
            sorts[path] = FREE

    visit(whole_schema, (), ())
    return sorts


def find_free_fields():
    """Return the key paths of a mechanism file that hold any text."""
    return [path for path, sort in find_text_fields().items() if sort == FREE]


def hostile_file(text, name="four_bar"):
    """Return the file of a shipped mechanism with a text in every field for any text.

    Tests use texts that some language would read as code, and check that exports escape
    them. The text is also put into a comment, and into the table `user` as a key and a
    value.
    """
    data = tomllib.loads((ROOT / f"mechanisms/{name}.toml").read_text("utf-8"))
    for *table_names, key in find_free_fields():
        # In the path of a field, "*" stands for a table with any name, such as a link. The
        # text cannot be put there, since this name is not known.
        assert "*" not in table_names, f"{table_names}: unknown where this text is put"
        table = data
        for table_name in table_names:
            table = table.setdefault(table_name, {})
        table[key] = {"text": text, text: [text]} if key == "user" else text
    # Comments of TOML have no control characters and no line ends.
    line = " ".join(text.split())
    comment = "".join(x for x in line if ord(x) >= 32 and ord(x) != 127)
    lines = [f"# {comment}"]
    for key, value in data.items():
        if isinstance(value, dict):
            lines += table_lines((key,), value)
        else:
            lines.append(assignment_text(key, value))
    return "\n".join([*lines, ""])
