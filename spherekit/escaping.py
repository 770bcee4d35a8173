r"""Text of mechanism files, escaped for the language that it is written into.

There is one function for each language. Each returns text that is read as text there: it
ends no comment, string, element or cell, and starts nothing. `HIDDEN_CHARACTERS`, such as
those that change how what follows is displayed, are written as ``[U+202E]``.

Names of generated functions and enumerators are not here but in
`spherekit.exchange.identifiers`.
"""

import html
import json
import re
from typing import Any

_CONTROLS = r"\x00-\x1f\x7f-\x9f"
_SEPARATORS = r"\u2028\u2029"
_DIRECTIONS = r"\u061c\u200e\u200f\u202a-\u202e\u2066-\u2069"
_NO_CHARACTERS = r"\ud800-\udfff\ufdd0-\ufdef\ufeff\ufff9-\ufffb\ufffe\uffff" + "".join(
    f"\\U{plane:04x}fffe\\U{plane:04x}ffff" for plane in range(1, 17)
)
_TAGS = r"\U000e0000-\U000e007f"
HIDDEN_CHARACTERS = re.compile(
    f"[{_CONTROLS}{_SEPARATORS}{_DIRECTIONS}{_NO_CHARACTERS}{_TAGS}]"
)
"""Characters that are not seen as themselves.

Control characters, line and paragraph separators, marks of the writing direction,
surrogates and code points that are no characters, and the tags of plane 14. Joiners,
no-break spaces, spaces without width and soft hyphens are not among them: scripts and
languages need them.
"""

_TOML = {"\n": "\\n", "\t": "\\t", "\r": "\\r", "\b": "\\b", "\f": "\\f"}
_LATEX = {
    "\\": r"\textbackslash{}",
    "~": r"\textasciitilde{}",
    "^": r"\textasciicircum{}",
    **{mark: f"\\{mark}" for mark in "{}$&#_%"},
    # The default fonts of LaTeX have other signs at the places of these three.
    "<": r"\textless{}",
    ">": r"\textgreater{}",
    "|": r"\textbar{}",
    # Ligatures and active characters: `` -- ?` ,, would be printed as other signs.
    **{mark: f"{mark}{{}}" for mark in "`'-\"?!,"},
}


def visible(text: str, allowed: str = "\n\t") -> str:
    """Return a text in which hidden characters are written as codes such as ``[U+202E]``.

    Hidden characters are control characters, marks of the writing direction and others that
    are not seen. They could make a text look different from what it is.

    Parameters
    ----------
    text
        The text.
    allowed
        Characters among `HIDDEN_CHARACTERS` that stay as they are.
    """

    def write(match: re.Match[str]) -> str:
        """Return a hidden character as its code, unless it is allowed."""
        character = match[0]
        return character if character in allowed else f"[U+{ord(character):04X}]"

    return HIDDEN_CHARACTERS.sub(write, text)


def one_line(text: str) -> str:
    """Return a text on one line, with its hidden characters visible.

    A run of line ends, tabs and form feeds becomes one space, also with spaces in it or
    beside it. Other spaces stay as they are.

    Names from mechanism files are written into source code and reports. A hidden line end
    could start something there.
    """
    # A match begins at the first space of a run: long runs then take no quadratic time.
    run = r"(?<! ) *[\t\n\v\f\r][\t\n\v\f\r ]*"
    return visible(re.sub(run, " ", text), allowed="")


def c_comment(line: str) -> str:
    r"""Return one line for a comment of C or C++, ``/* ... */`` or ``//``.

    The text comes from a mechanism file and must not end the comment or cause a warning.
    ``*/`` would end it, and ``/*`` is an error under ``-Werror=comment``. A backslash at
    the end of a line joins the next line to it. So does a backslash before spaces, or the
    trigraph ``??/``.
    """
    line = re.sub(r"\?(?=\?)", "? ", one_line(line))
    line = line.replace("*/", "* /").replace("/*", "/ *")
    return re.sub(r"\\(?=\s|$)", "[U+005C]", line)


def javascript_comment(line: str) -> str:
    """Return one line for a ``//`` comment of JavaScript, also within a page.

    In an HTML page ``</script`` ends the script, even in a comment. After ``<!--`` and
    ``<script``, browsers no longer find the end of the script. A space after ``<`` prevents
    these two effects.
    """
    return re.sub(r"<(?=[!/?A-Za-z])", "< ", one_line(line))


def python_comment(line: str) -> str:
    """Return one line for a ``#`` comment of Python.

    In the first two lines of a file, a comment with ``coding:`` states the encoding (PEP
    263). A space prevents this.
    """
    return re.sub(r"coding(?=[:=])", "coding ", one_line(line))


def julia_comment(line: str) -> str:
    """Return one line for a ``#`` comment of Julia; ``#=`` would begin a longer one."""
    return one_line(line).replace("#=", "# =").replace("=#", "= #")


def julia_string(text: str) -> str:
    """Return a string literal of Julia, in which ``$`` would insert a variable."""
    escaped = text.replace("\\", "\\\\").replace('"', '\\"').replace("$", "\\$")
    return (
        '"' + HIDDEN_CHARACTERS.sub(lambda match: f"\\U{ord(match[0]):08x}", escaped) + '"'
    )


def json_text(value: Any, indent: int | None = None) -> str:
    r"""Return a value as JSON that can stand in files, terminals and scripts of pages.

    It is read as the same value everywhere. Hidden characters are escaped for terminals
    and for JavaScript, where U+2028 ends lines. ``<`` is escaped for pages, where
    ``</script>`` and ``<!--<script`` within a script are markup.
    """
    written = json.dumps(value, indent=indent, ensure_ascii=False).replace("<", "\\u003c")
    # JSON writes line ends within strings as \n, so the others belong to the layout.
    return HIDDEN_CHARACTERS.sub(
        lambda match: "\n" if match[0] == "\n" else json.dumps(match[0])[1:-1], written
    )


def html_text(text: object) -> str:
    """Return text for an element, or for an attribute in quotes, of HTML."""
    return html.escape(visible(str(text)))


def xml_comment(text: str) -> str:
    """Return the text of a comment of XML, which has no ``--`` and no ``-`` at its end."""
    spaced = re.sub(r"-(?=-)", "- ", one_line(text))
    return f"{spaced} " if spaced.endswith("-") else spaced


def toml_string(text: str) -> str:
    """Return a text as a string of TOML, from which exactly the same text is read.

    Hidden characters, such as control characters and marks of the writing direction, are
    written as escape sequences. TOML has none for surrogates (U+D800 to U+DFFF). They stay
    in the text, so that writing it as UTF-8 raises an error.
    """

    def write(match: re.Match[str]) -> str:
        """Return a hidden character as an escape sequence of TOML."""
        code = ord(match[0])
        if 0xD800 <= code <= 0xDFFF:
            return match[0]
        numbered = f"\\u{code:04x}" if code < 2**16 else f"\\U{code:08x}"
        # Line ends, tabs and some other characters have short sequences such as \n.
        return _TOML.get(match[0], numbered)

    escaped = text.replace("\\", "\\\\").replace('"', '\\"')
    return f'"{HIDDEN_CHARACTERS.sub(write, escaped)}"'


def toml_comment(line: str) -> str:
    """Return one line for a ``#`` comment of TOML."""
    return one_line(line)


def latex_text(text: str) -> str:
    """Return a text of which LaTeX prints every sign; several spaces are printed as one."""
    return "".join(_LATEX.get(character, character) for character in one_line(text))


def markdown_text(text: str) -> str:
    """Return one line for Markdown: no emphasis, link, image, markup or formula in it.

    At the beginning of a line any sign may begin a list, a heading, a rule or a comment.
    Spaces there are removed, since four of them would begin code. Underscores within words,
    such as those of addresses, have no meaning.
    """
    line = re.sub(r"[\\`*\[\]<>|~$&]", r"\\\g<0>", one_line(text).lstrip(" "))
    line = re.sub(r"(?<![A-Za-z0-9])_|_(?![A-Za-z0-9])", r"\\_", line)
    line = re.sub(r"^[!-/:-@{}^]", r"\\\g<0>", line)
    return re.sub(r"^(\d+)([.)])", r"\1\\\2", line)


def plot_text(text: str) -> str:
    r"""Return a text that Matplotlib prints as it is.

    A pair of ``$`` would begin a formula. A curve with a label that begins with ``_`` is
    left out of the legend, so a space is put in front.
    """
    escaped = visible(text).replace("$", "\\$")
    return f" {escaped}" if escaped.startswith("_") else escaped


def terminal_text(text: str) -> str:
    """Return a text for a terminal: its control sequences do nothing."""
    return visible(text)
