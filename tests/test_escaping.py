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
EVERY = "\n".join(TEXTS.values())
MARK = {"js": "//", "python": "#", "casadi": "#", "julia": "#", "cpp": "//", "c": " *"}


@cache
def angle():
    """Return the formulas of one angle."""
    return formulas("four_bar", ["theta_41"])


def exported(folder, text, language):
    """Return the path of a mechanism with a text, exported by the command."""
    file = folder / "four_bar.toml"
    file.write_text(hostile_file(text), "utf-8")
    target = folder / f"out.{ENDINGS[language]}"
    words = ["export", str(file), "--to", language, "-o", str(target), "--quiet"]
    sources = language in MARK
    assert main([*words, *(["--quantities", "theta_41"] if sources else [])]) == 0
    return target


def printed(folder, text, language, name="printed"):
    """Return the path of a source with a text, as the command writes it."""
    path = folder / f"{name}.{ENDINGS[language]}"
    mechanism = replace(angle().mechanism, source=Source(text, text))
    path.write_text(source(replace(angle(), mechanism=mechanism), language), "utf-8")
    return path


@pytest.fixture(scope="module")
def harmless(tmp_path_factory):
    """Returns the export to a language of the file with a plain citation."""
    return cache(
        lambda language: exported(tmp_path_factory.mktemp(language), "plain", language)
    )


def words_of(text):
    """Return the runs of letters and digits that a reader has to find again."""
    return re.findall(r"[^\W_]+", re.sub(r"[\W_]", " ", text))[:400]


def assert_readable(text, comment):
    """Every word stands in a comment in its order; long ones may be broken there."""
    letters = re.sub(r"\[U\+[0-9A-F]+\]|[\W_]", "", comment)
    for word in words_of(text):
        assert word in letters, word


def comment_of(path, language):
    """Return the lines at the head of a source that are its comment, without marks."""
    lines = path.read_text("utf-8").split("\n")[1 if language == "c" else 0 :]
    mark = MARK[language]
    head = []
    for line in lines:
        if not line.startswith(mark) or line == " */":
            break
        head.append(line.removeprefix(mark))
    return "\n".join(head)


def compiler_of(language):
    """Return the words that call the strict compiler of C or C++."""
    if language == "c":
        return [GCC, "-std=c99", *STRICT, "-x", "c"]
    return [GPP, "-std=c++11", *STRICT, "-x", "c++"]


def assert_compiles(paths, language):
    """Sources are correct, by the compiler or interpreter of their language."""
    files = [str(path) for path in paths]
    if language in ("c", "cpp"):
        subprocess.run([*compiler_of(language), "-fsyntax-only", *files], check=True)
    elif language == "js":
        urls = json.dumps([path.as_uri() for path in paths])
        program = f"for (const url of {urls}) await import(url);"
        subprocess.run([NODE, "--input-type=module", "-e", program], check=True)


def stripped(path, language):
    """Return what a language reads of a source: no comment is left in it.

    The preprocessor of C warns about signs in comments that look like code.
    """
    if language in ("c", "cpp"):
        words = [*compiler_of(language), "-E", "-P", str(path)]
        return subprocess.run(words, check=True, capture_output=True).stdout
    if language == "js":
        # The lines of ECMAScript, which a // comment ends with.
        lines = re.split("\r\n|[\n\r\u2028\u2029]", path.read_text("utf-8"))
        return [line for line in lines if not line.startswith("//")]
    if language == "julia":
        lines = path.read_text("utf-8").split("\n")
        return [line for line in lines if not re.match("#(?!=)", line)]
    source = path.read_bytes()
    encoding, _ = tokenize.detect_encoding(io.BytesIO(source).readline)
    assert encoding == "utf-8"
    return ast.dump(ast.parse(source))


NEEDED = {"c": GCC, "cpp": GPP, "js": NODE}


@pytest.mark.many
@pytest.mark.parametrize("language", MARK)
def test_hostile_texts_are_comments_of_sources(language, harmless, tmp_path):
    if not NEEDED.get(language, "always"):
        pytest.skip(f"there is no compiler of {language}")
    code = stripped(harmless(language), language)
    of_command = exported(tmp_path, EVERY, language)
    assert stripped(of_command, language) == code
    paths = {
        what: printed(tmp_path, text, language, f"printed_{number}")
        for number, (what, text) in enumerate(TEXTS.items())
    }
    # What the preprocessor leaves of each is the same, so that one file is enough in C.
    every = [*paths.values()] if language == "js" else []
    assert_compiles([harmless(language), of_command, *every], language)
    for what, text in TEXTS.items():
        path = paths[what]
        assert stripped(path, language) == code, what
        comment = comment_of(path, language)
        assert not escaping.HIDDEN_CHARACTERS.search(comment.replace("\n", "")), what
        assert_readable(text, comment)


def test_a_module_of_hostile_texts_runs(tmp_path):
    """What `node` imports has no more than what it exports."""
    if not NODE:
        pytest.skip("there is no node")
    path = exported(tmp_path, EVERY, "js")
    program = (
        f"import * as made from {json.dumps(path.as_uri())};"
        "console.log(JSON.stringify([Object.keys(made), globalThis.HACKED ?? 0]))"
    )
    words = [NODE, "--input-type=module", "-e", program]
    said = subprocess.run(words, check=True, capture_output=True, text=True).stdout
    assert json.loads(said) == [["four_bar", "four_bar_about"], 0]


def test_hostile_texts_are_comments_of_models(harmless, tmp_path):
    bare = ElementTree.canonicalize(harmless("mjcf").read_text("utf-8"))
    made, values = find_pose(sk.load("four_bar"), 0, None)
    for what, text in TEXTS.items():
        written = MujocoModel(replace(made, source=Source(text)), values).text
        assert ElementTree.canonicalize(written) == bare, what
        keeps_comments = ElementTree.TreeBuilder(insert_comments=True)
        root = ElementTree.fromstring(written, ElementTree.XMLParser(target=keeps_comments))
        comments = [x.text for x in root if not isinstance(x.tag, str)]
        assert not any("--" in x or x.endswith("-") for x in comments), what
        assert_readable(text, comments[0])


@pytest.mark.parametrize("language", ["latex", "coupling"])
def test_hostile_texts_are_not_in_what_has_no_place_for_them(language, harmless, tmp_path):
    plain = harmless(language).read_text("utf-8")
    hashed = re.compile("SHA-256 of the mechanism: [0-9a-f]{64}")
    written = exported(tmp_path, EVERY, language).read_text("utf-8")
    assert hashed.sub("", written) == hashed.sub("", plain)


@pytest.mark.many
@pytest.mark.parametrize("what", TEXTS)
def test_hostile_texts_come_back_from_files(what, tmp_path):
    mechanism = loads(hostile_file(TEXTS[what]), what)
    assert mechanism.source.citation == mechanism.source.assumed == TEXTS[what]
    written = dumps(mechanism)
    assert loads(written, what) == mechanism
    assert not escaping.HIDDEN_CHARACTERS.search(written.replace("\n", ""))
    saved = "".join(
        repr(number) if isinstance(number := part, int) else part
        for part in PageMaker(mechanism, [], ["q"], None).make_model([])["toml"]
    )
    assert loads(saved, what) == mechanism


def test_every_field_that_takes_any_text_is_hostile_here():
    """A new field of the format is found by its schema, and put into the files above."""
    for text in ("*/ plain", "\u2028"):
        document = hostile_file(text)
        assert document.count(escaping.toml_string(text)) >= len(find_free_fields())
    every = {
        path for kind in ("mechanism",) for path, sort in find_text_fields(kind).items()
    }
    assert {("source", "citation"), ("user",), ("loads", "*", "torque")} <= every
    assert all(sort != FREE for path, sort in find_text_fields().items() if "*" in path)


@pytest.mark.many
@pytest.mark.parametrize("what", sorted(TEXTS))
def test_names_and_expressions_are_refused_in_visible_letters(what, tmp_path, capsys):
    """Names and expressions take no such text, and the message is safe to print."""
    text = TEXTS[what]
    quoted = escaping.toml_string(text)
    file = tmp_path / "wrong.toml"
    good = hostile_file("plain")
    places = {
        "name": re.sub(r'^name = ".*"', lambda _: f"name = {quoted}", good, flags=re.M),
        "torque": good + f'\n[loads.l]\npair = "21"\ntorque = {quoted}\n',
        "output": good + f"\n[outputs.{quoted}]\nlink = '4'\n",
        "mode": good + f"\n[modes.{quoted}]\n21 = 0.0\n",
    }
    for place, document in places.items():
        file.write_text(document, "utf-8")
        assert main(["validate", str(file)]) == 1, place
        said = capsys.readouterr().err
        assert len(said) > 30 and not escaping.HIDDEN_CHARACTERS.search(
            said.replace("\n", "")
        ), place


def test_a_path_with_hidden_characters_is_printed_visibly(tmp_path, capsys):
    for command in (["validate"], ["plan"], ["run"], ["page"], ["export", "--to", "c"]):
        first, *others = command
        assert main([first, str(tmp_path / "\u202ered\u2028.toml"), *others]) == 1
        said = capsys.readouterr().err
        assert "red" in said
        assert not escaping.HIDDEN_CHARACTERS.search(said.replace("\n", ""))


def test_a_citation_on_the_terminal_is_visible(monkeypatch, capsys):
    """The list of mechanisms prints what packs of others cite."""
    hostile = loads(hostile_file(EVERY), "hostile")
    monkeypatch.setattr("spherekit.files.mechanism_reader.load", lambda name: hostile)
    assert main(["mechanisms"]) == 0
    lines = capsys.readouterr().out.split("\n")
    assert (
        not escaping.HIDDEN_CHARACTERS.search("".join(lines))
        and "[U+001B][31mred" in lines[0]
    )
    assert len(lines) == len(sk.mechanisms()) + 2  # a study, and the end
    assert main(["mechanisms", "--json"]) == 0
    said = capsys.readouterr().out
    assert not escaping.HIDDEN_CHARACTERS.search(said.replace("\n", ""))
    assert json.loads(said)[0]["source"] == hostile.source.citation


@pytest.mark.parametrize("what", TEXTS)
def test_markdown_prints_hostile_texts_as_they_are(what):
    """Read by a parser of CommonMark with tables and struck text: one plain paragraph."""
    parser = pytest.importorskip("markdown_it", reason="it reads Markdown").MarkdownIt()
    text = escaping.one_line(TEXTS[what]).strip()
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
    mechanism = loads(hostile_file(EVERY), "hostile")
    (motion,) = PositionAnalysis(mechanism, samples=1).blocks(10)
    source = f"Source: {escaping.markdown_text(EVERY)}"
    assert _size_table(motion, 0, "").markdown.endswith(source)
    (_, plan) = static_scene(plans(mechanism), [None]).primitives
    assert plan.markdown.endswith(source)


@pytest.mark.parametrize("what", TEXTS)
def test_texts_of_plots_are_no_formulas(what):
    """Matplotlib takes what is between two signs of dollar for a formula."""
    figure = pytest.importorskip("matplotlib.figure", reason="it draws").Figure()
    text = TEXTS[what][:300]
    shown = figure.text(0.0, 0.0, escaping.plot_text(text))
    letters, is_formula = shown._preprocess_math(shown.get_text())
    assert not is_formula and letters.strip() == escaping.visible(text).strip()


def test_curves_of_names_with_an_underscore_are_in_legends():
    axes = pytest.importorskip("matplotlib.figure", reason="it draws").Figure().subplots()
    for name in ("_p", "__p", "_", "p_"):
        axes.plot([0, 1], label=escaping.plot_text(name))
    _, labels = axes.get_legend_handles_labels()
    assert [label.strip() for label in labels] == ["_p", "__p", "_", "p_"]


@pytest.mark.parametrize("what", TEXTS)
def test_literals_are_read_as_the_same_text(what):
    text = TEXTS[what]
    value = {"text": text, text: [text, 1.5]}
    for indent in (None, 1):
        written = escaping.json_text(value, indent)
        assert json.loads(written) == value and "<" not in written
        assert not escaping.HIDDEN_CHARACTERS.search(written.replace("\n", ""))
    shown = escaping.html_text(text)
    assert html.unescape(shown) == escaping.visible(text) and not set('<>"') & set(shown)
    julia = escaping.julia_string(text)
    assert not re.search(r"(?<!\\)(?:\\\\)*\$", julia)
    assert ast.literal_eval(julia.replace("\\$", "$")) == text


def test_latex_prints_every_sign():
    """The ten special characters of LaTeX have a command or a backslash."""
    text = escaping.latex_text("\\ { } $ & # ^ _ ~ % ``--''")
    bare = re.sub(r"\\text(backslash|ascii\w+)\{\}|\\[{}$&#_%]|[`'-]\{\}| ", "", text)
    assert bare == ""


def test_names_of_foreign_models_stay_in_comments(tmp_path):
    """A line end in a name of MJCF would begin a key of the file."""
    pytest.importorskip("mujoco", reason="it reads the model")
    path = exported(tmp_path, "plain", "mjcf")
    text = path.read_text("utf-8")
    for letter in ("&#10;", "&#13;", "&#x2028;", "&#x85;"):
        name = f'"four_bar{letter}ground = 3"'
        path.write_text(text.replace('"four_bar"', name), "utf-8")
        made = sk.import_mechanism(path)
        assert made.mechanism.ground == "1"
        assert not escaping.HIDDEN_CHARACTERS.search(made.text.replace("\n", ""))


@pytest.fixture(scope="module")
def page_of(tmp_path_factory):
    """Writes the page of a file with a text, with as little as a page can have."""
    folder = tmp_path_factory.mktemp("pages")

    def written(text):
        file, page = folder / "hostile.toml", folder / "hostile.html"
        file.write_text(hostile_file(text), "utf-8")
        words = ["page", str(file), "-o", str(page), "--vary", "links.2.arc", "--quiet"]
        assert main([*words, "--quantities", "velocity_coefficient_4_1"]) == 0
        return file, page

    return written


@pytest.mark.slow
def test_pages_show_hostile_texts_and_run_none(page_of, browser):
    """Every page works without a message, with the elements of a harmless one."""
    said = []
    tab = browser.new_page()
    tab.on("console", lambda message: said.append(message.text))
    tab.on("pageerror", lambda error: said.append(str(error)))
    tab.on("dialog", lambda dialog: said.append(dialog.message))
    tab.route(re.compile("^http"), lambda route: said.append(route.request.url))

    def opened(text):
        file, page = page_of(text)
        tab.goto("about:blank")
        tab.goto(page.as_uri())
        wait_until(tab, "window.spherekit?.timing.pictures > 0")
        facts = tab.evaluate(
            "[document.querySelectorAll('*').length, window.HACKED ?? 0, "
            "document.getElementById('citation').textContent, document.title, "
            "document.getElementById('citation').title, spherekit.toml()]"
        )
        return file.read_text("utf-8"), facts

    _, (elements, *_) = opened("plain")
    for what, text in TEXTS.items():
        file, (count, hacked, citation, title, shown_above, saved) = opened(text)
        visible = re.sub("\r\n?", "\n", escaping.visible(text, "\n\t"))
        assert (count, hacked, title) == (elements, 0, "four_bar"), what
        assert citation == shown_above == visible, what
        assert loads(saved, "saved") == loads(file, "saved"), what
        assert not said, (what, said)
    tab.close()
