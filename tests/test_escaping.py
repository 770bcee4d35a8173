"""Texts of a file in every language that is written: nothing in them is active.

Each language is read by its own compiler or parser, and the result is compared with that
of the same file with a harmless citation: only comments may differ.
"""

import ast
import html
import io
import json
import re
import shutil
import subprocess
import time
import tokenize
from dataclasses import replace
from functools import cache
from xml.etree import ElementTree

import pytest
from helpers.hostile_texts import (
    FREE,
    TEXTS,
    find_free_fields,
    find_text_fields,
    hostile_file,
)
from helpers.page_waits import wait_until

import spherekit as sk
from spherekit import escaping
from spherekit.cli.main import main
from spherekit.display.pages.page import PageMaker
from spherekit.display.rerun.preview import _size_table
from spherekit.exchange.exported_pose import find_pose
from spherekit.exchange.formula_maker import formulas
from spherekit.exchange.mjcf import MujocoModel
from spherekit.exchange.source_languages import source
from spherekit.files.mechanism_reader import loads
from spherekit.files.mechanism_writer import dumps
from spherekit.mechanism.elements import Source
from spherekit.planning.pole_planner import plans
from spherekit.positions.position_analysis import PositionAnalysis
from spherekit.scenes.link_scenes import static_scene

GCC, GPP, NODE = map(shutil.which, ("gcc", "g++", "node"))
STRICT = ["-Wall", "-Wextra", "-Wbidi-chars=any", "-pedantic", "-Werror"]
ENDINGS = {"c": "c", "cpp": "hpp", "js": "mjs", "python": "py", "julia": "jl"}
ENDINGS |= {"casadi": "py", "latex": "tex", "mjcf": "xml", "coupling": "h", "file": "toml"}
ALL_HOSTILE_TEXTS = "\n".join(TEXTS.values())
MARK = {"js": "//", "python": "#", "casadi": "#", "julia": "#", "cpp": "//", "c": " *"}


@cache
def angle():
    """Return the formulas of one angle."""
    return formulas("four_bar", ["theta_41"])


def export_with_command(folder, text, language):
    """Export a mechanism with a text in all its free fields by the command; return the
    path.
    """
    file = folder / "four_bar.toml"
    file.write_text(hostile_file(text), "utf-8")
    target = folder / f"out.{ENDINGS[language]}"
    arguments = ["export", str(file), "--to", language, "-o", str(target), "--quiet"]
    sources = language in MARK
    assert main([*arguments, *(["--quantities", "theta_41"] if sources else [])]) == 0
    return target


def write_source(folder, text, language, name="printed"):
    """Write the source of a mechanism whose citation is a text; return its path."""
    path = folder / f"{name}.{ENDINGS[language]}"
    mechanism = replace(angle().mechanism, source=Source(text, text))
    path.write_text(source(replace(angle(), mechanism=mechanism), language), "utf-8")
    return path


@pytest.fixture(scope="module")
def harmless(tmp_path_factory):
    """Return a function from a language to the export of the file with a plain citation."""
    return cache(
        lambda language: export_with_command(
            tmp_path_factory.mktemp(language), "plain", language
        )
    )


def words_of(text):
    """Return the runs of letters and digits that a reader has to find again."""
    return re.findall(r"[^\W_]+", re.sub(r"[\W_]", " ", text))[:400]


def assert_readable(text, comment):
    """Assert that a comment has every word of a text, in one piece but for line breaks."""
    letters = re.sub(r"\[U\+[0-9A-F]+\]|[\W_]", "", comment)
    for word in words_of(text):
        assert word in letters, word


def comment_of(path, language):
    """Return the comment at the beginning of a source, without its marks."""
    lines = path.read_text("utf-8").split("\n")[1 if language == "c" else 0 :]
    mark = MARK[language]
    comment_lines = []
    for line in lines:
        if not line.startswith(mark) or line == " */":
            break
        comment_lines.append(line.removeprefix(mark))
    return "\n".join(comment_lines)


def compiler_of(language):
    """Return the words that call the strict compiler of C or C++."""
    if language == "c":
        return [GCC, "-std=c99", *STRICT, "-x", "c"]
    return [GPP, "-std=c++11", *STRICT, "-x", "c++"]


def assert_compiles(paths, language):
    """Assert that sources are correct, by the compiler or interpreter of their language."""
    files = [str(path) for path in paths]
    if language in ("c", "cpp"):
        subprocess.run([*compiler_of(language), "-fsyntax-only", *files], check=True)
    elif language == "js":
        urls = json.dumps([path.as_uri() for path in paths])
        program = f"for (const url of {urls}) await import(url);"
        subprocess.run([NODE, "--input-type=module", "-e", program], check=True)


def code_without_comments(path, language):
    """Return a source without its comments: the code that a program of the language sees.

    Tests check that hostile texts in comments do not change this code. For C and C++ the
    preprocessor removes the comments. Its warnings are errors, for example of a comment
    that begins within another comment. In JavaScript and Julia only lines that begin with a
    comment of one line are removed.
    """
    if language in ("c", "cpp"):
        words = [*compiler_of(language), "-E", "-P", str(path)]
        return subprocess.run(words, check=True, capture_output=True).stdout
    if language == "js":
        # A // comment ends at each of these line ends of ECMAScript.
        lines = re.split("\r\n|[\n\r\u2028\u2029]", path.read_text("utf-8"))
        return [line for line in lines if not line.startswith("//")]
    if language == "julia":
        # `#` begins a comment of one line, but `#=` one of several lines.
        lines = path.read_text("utf-8").split("\n")
        return [line for line in lines if not re.match("#(?!=)", line)]
    source = path.read_bytes()
    encoding, _ = tokenize.detect_encoding(io.BytesIO(source).readline)
    assert encoding == "utf-8"
    return ast.dump(ast.parse(source))


NEEDED = {"c": GCC, "cpp": GPP, "js": NODE}


def skip_without_compiler(language):
    """Skip a test if the compiler or interpreter of a language is not installed.

    Languages without an entry in `NEEDED` need none.
    """
    if not NEEDED.get(language, "always"):
        pytest.skip(f"there is no compiler of {language}")


def sources_with_hostile_citations(language, folder):
    """Return a source for each hostile citation (`TEXTS`), by the title of the citation."""
    return {
        title: write_source(folder, text, language, f"printed_{number}")
        for number, (title, text) in enumerate(TEXTS.items())
    }


@pytest.mark.many
@pytest.mark.parametrize("language", MARK)
def test_hostile_citations_change_only_the_comments_of_sources(
    language, harmless, tmp_path
):
    """Whatever a citation contains, the code of an exported source stays the same.

    The citation stands in a comment. `TEXTS` are hostile citations: they try to end the
    comment, to hide characters or to change the direction of writing. `harmless` exports
    the same mechanism with a plain citation; its code without comments is the expected
    code.
    """
    skip_without_compiler(language)
    expected_code = code_without_comments(harmless(language), language)
    all_texts_path = export_with_command(tmp_path, ALL_HOSTILE_TEXTS, language)
    assert code_without_comments(all_texts_path, language) == expected_code
    for title, path in sources_with_hostile_citations(language, tmp_path).items():
        assert code_without_comments(path, language) == expected_code, title


@pytest.mark.many
@pytest.mark.parametrize("language", MARK)
def test_sources_with_hostile_citations_compile(language, harmless, tmp_path):
    """The compiler accepts a source with all hostile citations (`TEXTS`) in its comment.

    A hostile citation tries to end the comment, or to hide characters. `harmless` exports a
    source with a plain citation, which must compile too. In JavaScript, the sources with a
    single hostile citation each are run as well. The test that compares the code of such
    sources only looks at the beginnings of their lines in JavaScript.
    """
    skip_without_compiler(language)
    paths = [
        harmless(language),
        export_with_command(tmp_path, ALL_HOSTILE_TEXTS, language),
    ]
    if language == "js":
        paths += sources_with_hostile_citations(language, tmp_path).values()
    assert_compiles(paths, language)


@pytest.mark.many
@pytest.mark.parametrize("language", MARK)
def test_all_words_of_a_hostile_citation_are_in_the_comment(language, tmp_path):
    """The comment at the head of the source shows no hidden character of the citation."""
    skip_without_compiler(language)
    path_by_title = sources_with_hostile_citations(language, tmp_path)
    for title, text in TEXTS.items():
        comment = comment_of(path_by_title[title], language)
        assert not escaping.HIDDEN_CHARACTERS.search(comment.replace("\n", "")), title
        assert_readable(text, comment)


def test_a_module_of_hostile_texts_runs(tmp_path):
    """Node imports a module with hostile texts; it has two functions and sets nothing."""
    if not NODE:
        pytest.skip("there is no node")
    path = export_with_command(tmp_path, ALL_HOSTILE_TEXTS, "js")
    program = (
        f"import * as made from {json.dumps(path.as_uri())};"
        "console.log(JSON.stringify([Object.keys(made), globalThis.HACKED ?? 0]))"
    )
    command = [NODE, "--input-type=module", "-e", program]
    output = subprocess.run(command, check=True, capture_output=True, text=True).stdout
    assert json.loads(output) == [["four_bar", "four_bar_about"], 0]


def test_hostile_texts_are_comments_of_models(harmless, tmp_path):
    """A hostile citation (`TEXTS`) changes only the comment of an exported MuJoCo model.

    `harmless` exports the model with a plain citation. Comments of XML may not contain two
    hyphens. All words of the citation must still be in the comment.
    """
    # Canonical XML has no comments.
    bare = ElementTree.canonicalize(harmless("mjcf").read_text("utf-8"))
    # The pair variables of the first configuration of assembly mode 0.
    mechanism, values = find_pose(sk.load("four_bar"), assembly_mode=0, inputs=None)
    for title, text in TEXTS.items():
        model_text = MujocoModel(replace(mechanism, source=Source(text)), values).text
        assert ElementTree.canonicalize(model_text) == bare, title
        keeps_comments = ElementTree.TreeBuilder(insert_comments=True)
        root = ElementTree.fromstring(
            model_text, ElementTree.XMLParser(target=keeps_comments)
        )
        # A comment has the function ElementTree.Comment as its tag, an element its name.
        comments = [node.text for node in root if node.tag is ElementTree.Comment]
        for comment in comments:
            assert "--" not in comment and not comment.endswith("-"), title
        assert_readable(text, comments[0])


@pytest.mark.parametrize("language", ["latex", "coupling"])
def test_exports_without_comments_do_not_depend_on_the_citation(
    language, harmless, tmp_path
):
    """LaTeX and coupling tables are equal with and without hostile texts, but for a
    checksum.
    """
    plain = harmless(language).read_text("utf-8")
    checksum = re.compile("SHA-256 of the mechanism: [0-9a-f]{64}")
    written = export_with_command(tmp_path, ALL_HOSTILE_TEXTS, language).read_text("utf-8")
    assert checksum.sub("", written) == checksum.sub("", plain)


@pytest.mark.many
@pytest.mark.parametrize("title", TEXTS)
def test_hostile_texts_come_back_from_files(title, tmp_path):
    """A hostile citation is the same after writing and reading, also from an HTML page.

    A hostile text has characters that some language reads as code, such as the end of a
    comment (`TEXTS`). The written file must have no hidden characters, such as control
    characters and marks of the writing direction.

    A page can save the mechanism file with the sizes that its user has chosen. It stores
    the file as a list of texts, with a gap for each size that has a slider. Here no size
    has one, so the joined texts are the file.
    """
    mechanism = loads(hostile_file(TEXTS[title]), title)
    assert mechanism.source.citation == mechanism.source.assumed == TEXTS[title]
    written = dumps(mechanism)
    assert loads(written, title) == mechanism
    written_without_line_ends = written.replace("\n", "")
    assert not escaping.HIDDEN_CHARACTERS.search(written_without_line_ends)
    page_maker = PageMaker(mechanism, vary=[], quantities=["q"], input_pair=None)
    model = page_maker.make_model(shown_names=[])
    assert loads("".join(model["toml"]), title) == mechanism


def test_hostile_files_fill_every_free_text_field():
    """The hostile file has its text in every field that takes any text, by the schema."""
    for text in ("*/ plain", "\u2028"):
        document = hostile_file(text)
        assert document.count(escaping.toml_string(text)) >= len(find_free_fields())
    every = {
        path for kind in ("mechanism",) for path, sort in find_text_fields(kind).items()
    }
    assert {("source", "citation"), ("user",), ("loads", "*", "torque")} <= every
    assert all(sort != FREE for path, sort in find_text_fields().items() if "*" in path)


@pytest.mark.many
@pytest.mark.parametrize("title", sorted(TEXTS))
def test_names_and_expressions_are_refused_in_visible_letters(title, tmp_path, capsys):
    """Hostile texts are refused as names and expressions, and the message is safe to print.

    The text is tried as the name of the mechanism, of an output and of an assembly mode,
    and as a torque. The message must have some words, and no hidden characters.
    """
    text = TEXTS[title]
    quoted = escaping.toml_string(text)
    file = tmp_path / "wrong.toml"
    plain_text = hostile_file("plain")
    documents = {
        "name": re.sub(
            r'^name = ".*"', lambda _: f"name = {quoted}", plain_text, flags=re.M
        ),
        "torque": plain_text + f'\n[loads.l]\npair = "21"\ntorque = {quoted}\n',
        "output": plain_text + f"\n[outputs.{quoted}]\nlink = '4'\n",
        "mode": plain_text + f"\n[modes.{quoted}]\n21 = 0.0\n",
    }
    for field, document in documents.items():
        file.write_text(document, "utf-8")
        assert main(["validate", str(file)]) == 1, field
        message = capsys.readouterr().err
        assert len(message) > 30 and not escaping.HIDDEN_CHARACTERS.search(
            message.replace("\n", "")
        ), field


def test_a_path_with_hidden_characters_is_printed_visibly(tmp_path, capsys):
    """Every command prints a path with hidden characters in visible ones."""
    for command in (["validate"], ["plan"], ["run"], ["page"], ["export", "--to", "c"]):
        first, *others = command
        assert main([first, str(tmp_path / "\u202ered\u2028.toml"), *others]) == 1
        message = capsys.readouterr().err
        assert "red" in message
        assert not escaping.HIDDEN_CHARACTERS.search(message.replace("\n", ""))


def test_a_citation_on_the_terminal_is_visible(monkeypatch, capsys):
    """The list of mechanisms prints hidden characters of a citation as visible codes.

    Citations can come from packs of mechanisms by other people. Here every mechanism has a
    hostile one. In JSON the citation must still be complete.
    """
    hostile = loads(hostile_file(ALL_HOSTILE_TEXTS), "hostile")
    monkeypatch.setattr("spherekit.files.mechanism_reader.load", lambda name: hostile)
    assert main(["mechanisms"]) == 0
    lines = capsys.readouterr().out.split("\n")
    assert not escaping.HIDDEN_CHARACTERS.search("".join(lines))
    # Each mechanism has one line.
    marked_lines = [line for line in lines if "[U+001B][31mred" in line]
    assert len(marked_lines) == len(sk.mechanisms())
    assert main(["mechanisms", "--json"]) == 0
    output = capsys.readouterr().out
    assert not escaping.HIDDEN_CHARACTERS.search(output.replace("\n", ""))
    assert json.loads(output)[0]["source"] == hostile.source.citation


@pytest.mark.parametrize("title", TEXTS)
def test_markdown_prints_hostile_texts_as_they_are(title):
    """Escaped texts are one plain paragraph to a parser of CommonMark with tables."""
    parser = pytest.importorskip("markdown_it", reason="it reads Markdown").MarkdownIt()
    text = escaping.one_line(TEXTS[title]).strip()
    parser.enable(["table", "strikethrough"])
    block, inline, end = parser.parse(escaping.markdown_text(text))
    assert (block.type, inline.type, end.type) == (
        "paragraph_open",
        "inline",
        "paragraph_close",
    )
    assert {token.type for token in inline.children} <= {"text", "text_special"}
    assert "".join(token.content for token in inline.children) == text


def test_texts_of_recordings_have_the_citation_in_markdown():
    mechanism = loads(hostile_file(ALL_HOSTILE_TEXTS), "hostile")
    (motion,) = PositionAnalysis(mechanism, samples=1).blocks(10)
    source = f"Source: {escaping.markdown_text(ALL_HOSTILE_TEXTS)}"
    assert _size_table(motion, 0, "").markdown.endswith(source)
    (_, plan) = static_scene(plans(mechanism), [None]).primitives
    assert plan.markdown.endswith(source)


@pytest.mark.parametrize("title", TEXTS)
def test_texts_of_plots_are_no_formulas(title):
    """Matplotlib takes what is between two dollar signs for a formula; escaped texts have
    none.
    """
    figure = pytest.importorskip("matplotlib.figure", reason="it draws").Figure()
    text = TEXTS[title][:300]
    label = figure.text(0.0, 0.0, escaping.plot_text(text))
    letters, is_formula = label._preprocess_math(label.get_text())
    assert not is_formula and letters.strip() == escaping.visible(text).strip()


def test_curves_of_names_with_an_underscore_are_in_legends():
    axes = pytest.importorskip("matplotlib.figure", reason="it draws").Figure().subplots()
    for name in ("_p", "__p", "_", "p_"):
        axes.plot([0, 1], label=escaping.plot_text(name))
    _, labels = axes.get_legend_handles_labels()
    assert [label.strip() for label in labels] == ["_p", "__p", "_", "p_"]


@pytest.mark.parametrize("title", TEXTS)
def test_literals_of_json_html_and_julia_are_read_as_the_same_text(title):
    """JSON, HTML and Julia literals of a hostile text are read as the same text.

    - JSON has no "<", so that it can stand in a page of HTML.
    - HTML shows a hidden character, such as a mark of the writing direction, as its code
      (`escaping.visible` writes U+202E as "[U+202E]").
    - Julia strings have no active "$", which would insert the value of an expression.
    """
    text = TEXTS[title]
    value = {"text": text, text: [text, 1.5]}
    for indent in (None, 1):
        written = escaping.json_text(value, indent)
        assert json.loads(written) == value and "<" not in written
        assert not escaping.HIDDEN_CHARACTERS.search(written.replace("\n", ""))
    shown = escaping.html_text(text)
    assert html.unescape(shown) == escaping.visible(text) and not set('<>"') & set(shown)
    julia = escaping.julia_string(text)
    # A "$" is active if the number of backslashes before it is even.
    for backslashes in re.findall(r"(\\*)\$", julia):
        assert len(backslashes) % 2 == 1
    assert ast.literal_eval(julia.replace("\\$", "$")) == text


@pytest.mark.parametrize("beginning", ["# ", "- ", "1. ", "code ", "> "])
@pytest.mark.parametrize("spaces", [" ", "   ", "     ", "\t"])
def test_markdown_has_no_markup_after_spaces_at_the_beginning(beginning, spaces):
    parser = pytest.importorskip("markdown_it", reason="it reads Markdown").MarkdownIt()
    block, inline, _ = parser.parse(escaping.markdown_text(f"{spaces}{beginning}x"))
    assert block.type == "paragraph_open"
    assert "".join(token.content for token in inline.children) == f"{beginning}x"


def test_code_points_that_are_no_characters_are_written_as_codes():
    """The last two code points of each of the 17 planes are no characters."""
    for plane in range(17):
        for code in (plane * 0x10000 + 0xFFFE, plane * 0x10000 + 0xFFFF):
            assert escaping.visible(f"a{chr(code)}") == f"a[U+{code:04X}]"


def test_long_runs_of_spaces_take_little_time_on_one_line():
    text = f"a{' ' * 100_000}b"
    start = time.process_time()
    assert escaping.one_line(text) == text
    assert time.process_time() - start < 5.0
    assert escaping.one_line("a  \n \t b  c \n") == "a b  c "


def test_latex_prints_pairs_of_signs_without_ligatures():
    text = escaping.latex_text("?` !` ,, `` '' -- << >>")
    for pair in ("?`", "!`", ",,", "``", "''", "--", "<<", ">>"):
        assert pair not in text


def test_latex_prints_signs_that_its_default_fonts_lack_by_commands():
    """Bare, they would be printed as inverted question marks, dashes and the like."""
    assert escaping.latex_text("a<b>c|") == r"a\textless{}b\textgreater{}c\textbar{}"


def test_latex_prints_every_sign():
    """The ten special characters of LaTeX have a command or a backslash."""
    text = escaping.latex_text("\\ { } $ & # ^ _ ~ % ``--''")
    bare = re.sub(r"\\text(backslash|ascii\w+)\{\}|\\[{}$&#_%]|[`'-]\{\}| ", "", text)
    assert bare == ""


def test_names_of_foreign_models_stay_in_comments(tmp_path):
    """A line end in a name of an imported MJCF model does not begin a key of the file."""
    pytest.importorskip("mujoco", reason="it reads the model")
    path = export_with_command(tmp_path, "plain", "mjcf")
    text = path.read_text("utf-8")
    for line_end in ("&#10;", "&#13;", "&#x2028;", "&#x85;"):
        name = f'"four_bar{line_end}ground = 3"'
        path.write_text(text.replace('"four_bar"', name), "utf-8")
        result = sk.import_mechanism(path)
        assert result.mechanism.ground == "1"
        assert not escaping.HIDDEN_CHARACTERS.search(result.text.replace("\n", ""))


@pytest.fixture(scope="module")
def write_page(tmp_path_factory):
    """Return a function that writes a hostile file and its page, and returns both paths."""
    folder = tmp_path_factory.mktemp("pages")

    def write_file_and_page(text):
        file, page = folder / "hostile.toml", folder / "hostile.html"
        file.write_text(hostile_file(text), "utf-8")
        arguments = ["page", str(file), "-o", str(page), "--vary", "links.2.arc", "--quiet"]
        assert main([*arguments, "--quantities", "velocity_coefficient_4_1"]) == 0
        return file, page

    return write_file_and_page


@pytest.mark.slow
def test_pages_show_hostile_texts_and_run_none(write_page, browser):
    """A page shows a hostile citation as visible text and executes nothing of it.

    `write_page` writes the page of a mechanism with the citation, and `browser` opens it.
    The page must have as many elements as a page with a plain citation. It must cause no
    message in the console, no dialog and no request to the network. The mechanism file that
    it saves must have the content of the original file.
    """
    events = []
    tab = browser.new_page()
    tab.on("console", lambda message: events.append(message.text))
    tab.on("pageerror", lambda error: events.append(str(error)))
    tab.on("dialog", lambda dialog: events.append(dialog.message))
    tab.route(re.compile("^http"), lambda route: events.append(route.request.url))

    def open_page(text):
        """Open the page of a mechanism with a text; return its file and facts about it.

        If the text were executed, it would set `window.HACKED`.
        """
        file, page = write_page(text)
        # All pages have the same path. The tab would not load it again without leaving it.
        tab.goto("about:blank")
        tab.goto(page.as_uri())
        wait_until(tab, "window.spherekit?.timing.pictures > 0")
        facts = tab.evaluate(
            """({
            elements: document.querySelectorAll("*").length,
            hacked: window.HACKED ?? 0,
            citation: document.getElementById("citation").textContent,
            tooltip: document.getElementById("citation").title,
            title: document.title,
            saved: spherekit.toml()})"""
        )
        return file.read_text("utf-8"), facts

    _, harmless_facts = open_page("plain")
    for title, text in TEXTS.items():
        file_text, facts = open_page(text)
        # Hidden characters are shown as codes; line ends and tabs stay as they are.
        visible = re.sub("\r\n?", "\n", escaping.visible(text, allowed="\n\t"))
        assert facts["elements"] == harmless_facts["elements"], title
        assert facts["hacked"] == 0, title
        assert facts["title"] == "four_bar", title
        assert facts["citation"] == facts["tooltip"] == visible, title
        assert loads(facts["saved"], "saved") == loads(file_text, "saved"), title
        assert not events, (title, events)
    tab.close()
