"""The pages: their code runs, their commands print what they show, their links resolve."""

import importlib
import json
import re
import runpy
import shlex
import sys
import tomllib
from contextlib import nullcontext
from dataclasses import fields
from pathlib import Path

import numpy as np
import pytest
from helpers.console_text import shows
from helpers.public_packages import PUBLIC
from helpers.scene_listener import SceneListener

import spherekit as sk
from benchmarks.__main__ import main as benchmarks
from spherekit import errors
from spherekit.cli.command_line import COMMANDS, build_parser
from spherekit.cli.main import main
from spherekit.files.schema import schema
from spherekit.runs.registry import analysis_names, load_analysis, registered
from spherekit.runs.sampling import EVENTS
from spherekit.tables.table import INPUTS, MODE_NAME
from spherekit.velocities.row_quantities import row_quantities

ROOT = Path(__file__).parent.parent
DOCS = ROOT / "docs"
MECHANISMS = ROOT / "mechanisms"
MADE = DOCS / "generated"
PAGES = {
    **{x: (ROOT / x).read_text(encoding="utf-8") for x in ("README.md", "CONTRIBUTING.md")},
    **{
        path.relative_to(DOCS).as_posix(): path.read_text(encoding="utf-8")
        for path in sorted(DOCS.rglob("*.md"))
        if MADE not in path.parents
    },
}
BLOCK = re.compile(r"^```(\w+|\{run\})\n(.*?)^```$", re.M | re.S)
FILE_NAMES = {
    "toml": re.compile(r"# ([\w.]+\.toml)\n"),
    "xml": re.compile(r"<!-- ([\w.]+\.(?:urdf|xml)) -->\n"),
}
"""The first line of a block that is a file has its name, by the kind of the block."""
PLUGIN = "spherekit_torque_ratio"


def blocks(page, kind):
    """The blocks of a kind; those that the site runs share their names, so they are one."""
    found = BLOCK.findall(PAGES[page])
    shown = [code for name, code in found if name == kind]
    together = "".join(
        re.sub(r"^:.*\n", "", code, flags=re.M) for name, code in found if name == "{run}"
    )
    return [*shown, together] if kind == "python" and together else shown


def pages_with(kind):
    return [page for page in PAGES if blocks(page, kind)]


def tutorial():
    """The module of the plugin tutorial, and the code that uses it."""
    return blocks("plugins.md", "python")


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """Return a working folder with all files that pages show under a file name.

    Python finds the module of the plugin tutorial in it, and the helpers of the site in the
    folder of the documentation. One more file has a misspelt key; a page shows the message
    for it. `blocks` returns the code blocks of a page by their language.
    """
    for page in PAGES:
        for kind, file_name in FILE_NAMES.items():
            for text in blocks(page, kind):
                name = file_name.match(text)
                if name:
                    (tmp_path / name[1]).write_text(text, encoding="utf-8")
    crank_rocker = (tmp_path / "crank_rocker.toml").read_text(encoding="utf-8")
    misspelt = crank_rocker.replace("arcs = [60.0]", "arc = [60.0]")
    (tmp_path / "misspelt.toml").write_text(misspelt, encoding="utf-8")
    plugin_code = tutorial()[0]
    (tmp_path / f"{PLUGIN}.py").write_text(plugin_code, encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(str(DOCS))  # helpers of code that the site runs
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.setenv("MPLBACKEND", "Agg")
    importlib.invalidate_caches()
    yield tmp_path
    sys.modules.pop(PLUGIN, None)


NEEDS = {
    "import_mechanism(": "mujoco",
    "matplotlib": "matplotlib",
    ".plot(": "matplotlib",
    "site_pages": "sphinx",
}
"""The packages of extras, by what the Python of a page has in it that needs them."""


@pytest.mark.many(slow="all")
@pytest.mark.parametrize("page", pages_with("python"))
def test_python_runs(page, folder):
    for word, package in NEEDS.items():
        if any(word in code for code in blocks(page, "python")):
            pytest.importorskip(package)
    for number, code in enumerate(blocks(page, "python")):
        script = folder / f"block_{number}.py"
        script.write_text(code, encoding="utf-8")
        runpy.run_path(str(script))


def test_pages_import_from_public_packages_only():
    found = set()
    for text in PAGES.values():
        found |= set(re.findall(r"^ *(?:from|import) (spherekit[\w.]*)", text, re.M))
        found |= set(re.findall(r"\bimport (spherekit\.[\w.]+)", text))
    assert found - {PLUGIN} <= set(PUBLIC), found
    assert {"spherekit", "spherekit.plugin"} <= found


@pytest.mark.parametrize("page", pages_with("console"))
def test_console_blocks_show_what_commands_print(page, folder, capsys, monkeypatch):
    """Commands in the console blocks of a page print what the page shows.

    A command follows a `$`, and its output is on the lines below. A line `...` stands for
    any lines. Progress depends on the clock and is switched off. Rounding errors and sizes
    of files depend on the processor; `shows` lets them differ. `folder` has the files that
    pages show.
    """
    listener = "spherekit.progress.progress_listener"
    monkeypatch.setattr(listener, lambda listener: nullcontext())
    if any("spherekit import" in block for block in blocks(page, "console")):
        pytest.importorskip("mujoco")
    for block in blocks(page, "console"):
        for example in filter(None, re.split(r"^\$ ", block, flags=re.M)):
            command, _, shown = example.partition("\n")
            program, *arguments = shlex.split(command)
            assert program == "spherekit"
            main(arguments)
            printed = capsys.readouterr()
            text = printed.out + printed.err
            assert shows(shown, text), f"{command}\n{text}"


def test_commands_are_understood():
    for page, text in PAGES.items():
        # A backslash at its end continues a line of a shell.
        commands = re.sub(r"\\\n\s*", " ", "".join(blocks(page, "sh")))
        for line in commands.splitlines():
            program, *arguments = shlex.split(line.split(" #")[0]) or [""]
            if Path(program).name == "spherekit":
                build_parser().parse_args(arguments), page
        prose = BLOCK.sub("", text)
        for line in re.findall(r"`(spherekit (?:run|plan|explain|view) [^`\n]+)`", prose):
            if "..." not in line:
                build_parser().parse_args(shlex.split(line)[1:]), page


def test_links_resolve():
    for page, text in PAGES.items():
        home = ROOT if page in ("README.md", "CONTRIBUTING.md") else (DOCS / page).parent
        for target in re.findall(r"\]\(([^)\s]+)\)", BLOCK.sub("", text)):
            name, _, anchor = target.partition("#")
            path = (home / name).resolve() if name else home / Path(page).name
            if re.match(r"[a-z]+:", target):
                continue
            # Pages that are made exist on the site only. A role {doc}`text </generated/x>`
            # is no dead link for a reader of the source tree, and the site checks it.
            assert MADE not in path.parents, f"{page}: {target}: write {{doc}}`text </...>`"
            assert path.exists(), f"{page}: {target}"
            if anchor:
                assert anchor in anchors(path.read_text(encoding="utf-8")), target


def anchors(text):
    """The anchors of the headings of a page, as code hosts make them."""
    headings = re.findall(r"^#+ (.+)$", BLOCK.sub("", text), re.M)
    return {re.sub(r"[^\w\- ]", "", head).lower().replace(" ", "-") for head in headings}


def test_each_public_name_has_one_place_in_the_tables_of_the_api(monkeypatch):
    """The tables of the API list every public name, with a link to the page of this name.

    `USER_PURPOSES` sorts the names by purpose. If a name is missing there, the tables
    cannot be generated. No two file names of pages differ only in upper and lower case.
    """
    monkeypatch.syspath_prepend(str(DOCS))
    pytest.importorskip("sphinx")
    from site_pages.api import USER_PURPOSES, pages, sections

    made = dict(pages())
    index = made["api/index.md"]
    for name in sk.__all__:
        assert f"`{name}`" in index, name
    assert "[`load`](spherekit.load.rst)" in index
    assert "autofunction:: load" in made["api/spherekit.load.rst"]
    lower_names = [path.lower() for path in made]
    assert len(set(lower_names)) == len(lower_names), "files that differ in case alone"

    incomplete = dict(USER_PURPOSES)
    incomplete.pop("Loads")
    with pytest.raises(ValueError, match=r"missing: .*'Spring'"):
        list(sections("spherekit", incomplete))


def test_each_command_has_a_page_with_all_its_options(monkeypatch):
    monkeypatch.syspath_prepend(str(DOCS))
    pytest.importorskip("sphinx")
    from site_pages.commands import pages

    made = dict(pages())
    assert set(made) == {f"commands/{name}.md" for name in COMMANDS}
    assert "`--samples N[xM...]`" in made["commands/run.md"]
    assert "spherekit run four_bar" in made["commands/run.md"]


def test_key_reference_is_current():
    made = runpy.run_path(str(DOCS / "make_reference.py"))["page"]()
    assert made == PAGES["reference.md"], "run: python docs/make_reference.py"
    for kind in ("mechanism", "study", "synthesis"):
        for key in schema(kind)["properties"]:
            assert f"`{key}`" in made


def test_figures_of_the_extremes_are_those_of_their_record():
    made = runpy.run_path(str(DOCS / "make_extremes.py"))["page"]()
    assert made == PAGES["extremes.md"], "run: python docs/make_extremes.py"
    assert re.search(r"^Measured at commit [0-9a-f]{8}", made, re.M)


def test_the_page_of_benchmarks_is_made_from_its_record():
    made = runpy.run_path(str(DOCS / "make_benchmarks.py"))["page"]()
    assert made == PAGES["benchmarks.md"], "run: python docs/make_benchmarks.py"
    record = json.loads((DOCS / "benchmarks.json").read_text(encoding="utf-8"))
    sections = [section for own in record["benchmarks"].values() for section in own]
    assert len(sections) > 15
    for section in sections:
        assert re.fullmatch(r"[0-9a-f]{8,}", section["commit"]), section["title"]


def test_the_plugin_of_the_tutorial_is_installed_and_computes_its_ratio(folder):
    """The entry point in the shown pyproject.toml leads to the shown class, which works.

    The class is an analysis of the torque ratio of a link. This ratio is the reciprocal of
    the velocity coefficient of the link relative to the ground (pole 4/1). The ground is
    refused as the link. By default the link is that of the output, the rocker. `folder` has
    the module of the tutorial.
    """
    (project, _) = (tomllib.loads(text) for text in blocks("plugins.md", "toml"))
    entry_points = project["project"]["entry-points"]["spherekit.analyses"]
    ((name, target),) = entry_points.items()
    module, _, attribute = target.partition(":")
    assert project["tool"]["setuptools"]["py-modules"] == [module]
    analysis_class = getattr(importlib.import_module(module), attribute)
    assert analysis_class.name == name

    four_bar = sk.load("four_bar")
    with registered(analysis_class):
        result = sk.run(four_bar, [f"{name}:link=4", "poles"], samples=37)
        assert not result.failures
        poles = result.frame("poles").query("link == '4' and relative_to == '1'")
        coefficients = poles["velocity_coefficient"].to_numpy()
        ratio = result.frame(name)["ratio"].to_numpy()
        assert abs(ratio * coefficients - 1.0).max() < 1e-12
        with pytest.raises(sk.SpherekitError, match="is none of 2, 3, 4"):
            sk.run(four_bar, f"{name}:link=1")
        by_default = sk.run(four_bar, name, samples=37).frame()
        assert by_default.equals(result.frame(name))


def test_the_example_of_a_plugin_is_the_one_in_its_folder():
    """File by file; and the page names all that the kit offers."""
    example = ROOT / "examples" / "torque_ratio"
    shown = [blocks("plugins.md", "toml")[0], *tutorial()[:2]]
    for name, text in zip(
        ("pyproject.toml", f"{PLUGIN}.py", "test_torque_ratio.py"), shown, strict=True
    ):
        assert text == (example / name).read_text(encoding="utf-8"), name
    for module in PUBLIC:
        if f"{module}.".startswith("spherekit.plugin."):
            for name in importlib.import_module(module).__all__:
                assert f"`{name}`" in PAGES["plugins.md"], f"{module}: {name}"


def test_plugin_tutorial_has_a_scene(folder):
    cls, seen = importlib.import_module(PLUGIN).TorqueRatio, SceneListener()
    sk.run(sk.load("four_bar"), cls(link="4"), samples=5, recorder=seen)
    rows = [
        own for (_, path), own in seen.samples_by_primitive.items() if path == "plots/ratio"
    ]
    assert [len(own) for own in rows] == [5, 5]


def test_every_exception_is_told():
    told = "".join(PAGES.values())
    told += "".join(path.read_text() for path in (ROOT / "tests").glob("test_*.py"))
    for name, value in vars(errors).items():
        if isinstance(value, type) and issubclass(value, errors.SpherekitError):
            assert name in told


def test_every_status_and_public_object_is_explained():
    for status in sk.Status:
        assert f"`{status.name}`" in PAGES["motion.md"]
    for name in ("Mechanism", "Plan", "Motion", "RunResult", "Needs", "Batch"):
        assert f"`{name}`" in PAGES["architecture.md"]


def test_the_masses_loads_and_laws_shown_are_sound(folder):
    shown = blocks("mechanism-files.md", "toml")
    parts = [text for text in shown if re.match(r"\[(mass|loads|joint_limits)\.", text)]
    assert len(parts) == 3
    whole = "".join([(folder / "crank_rocker.toml").read_text(), *parts])
    (folder / "loaded.toml").write_text(whole, encoding="utf-8")
    mechanism = sk.load(folder / "loaded.toml")
    counts = len(mechanism.masses), len(mechanism.loads), len(mechanism.joint_limits)
    assert counts == (3, 4, 1)
    assert sk.load_study("turning.study.toml").laws["21"].duration == 8.0


def test_every_dependency_has_its_reason():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    extras = project["optional-dependencies"]
    wanted = [*project["dependencies"], *extras["docs"], *extras["test"]]
    for requirement in wanted:
        name = re.match(r"[\w-]+", requirement)[0]
        if name == project["name"]:
            continue  # the extras of its own
        assert re.search(rf"^\|.*\b{name}\b.*\|", PAGES["dependencies.md"], re.M), name


def test_the_readme_shows_a_picture_the_commands_and_a_short_file():
    """The README fits on two screens, and its file is the joint of its picture."""
    text = PAGES["README.md"]
    (shown,) = blocks("README.md", "toml")
    (picture,) = re.findall(r"!\[[^\]]+\]\((docs/images/\w+\.png)\)", text)
    assert (ROOT / picture).stat().st_size < 400_000
    order = [text.index(part) for part in (picture, "```sh", "```toml", "\n|")]
    assert order == sorted(order)
    assert f"spherekit run {Path(picture).stem} " in blocks("README.md", "sh")[0]
    assert len(text.splitlines()) <= 90
    assert len(shown.splitlines()) <= 20


def test_the_file_of_the_readme_is_a_universal_joint(folder):
    """The ratio of the shafts follows the formula of Hooke's joint.

    The angle of the driver is zero where its yoke lies in the plane of both shafts.
    """
    angles = np.array([0.0, 0.4, 1.3])
    results = sk.evaluate(sk.load("hooke.toml"), angles, assembly_mode=0)
    shaft_angle = np.radians(35.0)
    ratios = np.cos(shaft_angle) / (1.0 - (np.sin(shaft_angle) * np.cos(angles)) ** 2)
    computed = results.velocity_coefficient("follower/frame").ravel()
    assert np.allclose(computed, ratios, rtol=0.0, atol=1e-12)


@pytest.mark.slow
def test_every_question_of_the_readme_is_answered(folder, capsys):
    """Each command of the table of questions runs."""
    commands = [
        command
        for line in PAGES["README.md"].splitlines()
        if line.startswith("|")
        for command in re.findall(r"`spherekit ([^`]+)`", line)
    ]
    assert len(commands) >= 5
    for command in commands:
        assert main(shlex.split(command)) == 0, command
    assert (folder / "hooke.c").is_file()
    assert (folder / "hooke.html").is_file()


def page_tables(text):
    """The head and the rows of each table of a page, as cells."""
    for lines in re.findall(r"(?:^\|.*\n)+", text, re.M):
        head, _, *rows = (
            [cell.strip() for cell in re.split(r"(?<!\\)\|", line)[1:-1]]
            for line in lines.splitlines()
        )
        yield head, rows


def quoted(text):
    return re.findall(r"`([^`\n]+)`", text)


def columns_of_analyses():
    """The columns of all tables, with one for each input, and pair variables."""
    found = [*EVENTS.columns, INPUTS, MODE_NAME]
    for name in analysis_names():
        found += [
            column for table in load_analysis(name).tables for column in table.columns
        ]
    names = {column.name for column in found} | {"q_I", "tau_I", "theta_PAIR", "s_PAIR"}
    names |= {"s_PAIR_LINK"} | {f"{column.name}_I" for column in found if column.per_input}
    return names


@pytest.fixture(scope="module")
def declared():
    """Return all names that pages may mention, to find misspelt ones.

    They are the names of analyses with their parameters, tables and columns, the keys in
    the schemas of files, and the quantities of figures of merit (numbers to which a design
    is reduced). The file of a table is named after its analysis and the table.
    """
    names = columns_of_analyses() | set(analysis_names())
    for name in analysis_names():
        analysis = load_analysis(name)
        names |= {field.name for field in fields(analysis)}
        names |= {table.name for table in analysis.tables}
        names |= {f"{name}_{table.name}" for table in analysis.tables}
    # The table of the events of a simulation belongs to the motion, not to an analysis.
    names |= {f"motion_{EVENTS.name}"}
    for kind in ("mechanism", "study", "synthesis"):
        text = json.dumps(schema(kind))
        names |= set(re.findall(r'"(\w+)"', text))
    for mechanism in ("four_bar", "five_bar"):
        names |= set(row_quantities(sk.load(mechanism)))
    return names


NAMING = ("column", "table", "key", "parameter", "quantity")
"""Heads of tables that list columns, keys and parameters."""

OTHERS = {"framequat", "mj_rnePostConstraint", "float128", "q_left", "q_right"}
"""Names of other programs, and columns of a mechanism that only a page describes."""

OF_OTHER_PROGRAMS = ("--editable", "--dist", "--extra", "--keep-going", "--no-deps")


def is_declared(name, names):
    """Whether a name is in `names`, or is a pattern that fits one of them.

    In a pattern, such as theta_PAIR, a part in capitals stands for a name of the user's.
    """
    pattern = re.sub(r"(?<![A-Za-z])[A-Z][A-Z0-9]*(?![A-Za-z])", r"\\w+", name)
    return name in names or (
        pattern != name and any(re.fullmatch(pattern, full_name) for full_name in names)
    )


def test_columns_and_keys_that_pages_name_are_declared(declared):
    """Names of columns, keys and parameters in the pages exist in the program.

    Names are words in backquotes. Checked are those that follow "column", "key" or
    "parameter" in a sentence, and those in tables of a page. If a table has "table" as the
    head of its first column, all its cells have names of tables and columns. If this head
    is another word of `NAMING`, only the first column has names. `declared` has the names
    that exist.
    """
    # One or more words in backquotes, with "," or "and" or "or" between them.
    quoted_names = r"((?:`\w+`(?:,\s|\sand\s|\sor\s)?)+)"
    unknown = []
    for page, text in PAGES.items():
        prose = BLOCK.sub("", text)
        passages = re.findall(rf"\b(?:column|key|parameter)s?\s{quoted_names}", prose)
        for head, rows in page_tables(prose):
            if head[0] == "table":
                passages += ["|".join(row) for row in rows]
            elif head[0] in NAMING:
                passages += [row[0] for row in rows]
        for passage in passages:
            for name in quoted(passage):
                is_name = re.fullmatch(r"[a-z]\w*", name)
                if is_name and not is_declared(name, declared):
                    unknown.append(f"{page}: {name}")
    assert not unknown, "; ".join(unknown)


def test_options_that_pages_name_are_those_of_commands(capsys):
    """Every `--option` in a page is in the help of a command or of `python -m benchmarks`.

    Exceptions are `OF_OTHER_PROGRAMS`, the options of programs such as pip.
    """
    options = set(OF_OTHER_PROGRAMS)
    help_calls = [(main, command.split()) for command in ("", *COMMANDS)]
    help_calls.append((benchmarks, []))
    for function, words in help_calls:
        with pytest.raises(SystemExit):
            function([*words, "--help"])
        options |= set(re.findall(r"--[a-z][\w-]*", capsys.readouterr().out))
    unknown = []
    for page, text in PAGES.items():
        code_blocks = [code for _, code in BLOCK.findall(text)]
        for code in (*quoted(text), *code_blocks):
            for option in re.findall(r"(?<![\w-])--[a-z]+(?:-[a-z]+)*", code):
                if option not in options:
                    unknown.append(f"{page}: {option}")
    assert not unknown, "; ".join(unknown)


def test_names_in_pages_exist_in_the_sources(declared):
    """Every name in backquotes in the text of a page occurs in the program.

    This finds misspelt names, and names that were changed in the program but not in the
    page. A name may be any word of a source file or of a code block of a page, the name of
    a file, or one of `declared`, the names of columns, keys and quantities. Words that
    begin with a capital (classes, statuses and placeholders such as PAIR) or end with a
    digit are not checked.
    """
    # `OTHERS` are names of other programs that pages mention.
    permitted_names = declared | OTHERS
    permitted_names |= {path.name.split(".")[0] for path in MECHANISMS.iterdir()}
    for folder in ("spherekit", "analyses", "benchmarks", "tests", "docs/site_pages"):
        for path in (ROOT / folder).rglob("*.py"):
            permitted_names.add(path.stem)
            permitted_names |= set(re.findall(r"\w+", path.read_text("utf-8")))
    for text in PAGES.values():
        for _, code in BLOCK.findall(text):
            permitted_names |= set(re.findall(r"\w+", code))
    unknown = []
    for page, text in PAGES.items():
        for name in quoted(BLOCK.sub("", text)):
            # One word that begins with a lower-case letter and does not end with a digit.
            is_name = re.fullmatch(r"[a-z]\w*(?<!\d)", name)
            # `is_declared` also accepts patterns such as theta_PAIR that fit a name.
            if is_name and not is_declared(name, permitted_names):
                unknown.append(f"{page}: {name}")
    assert not unknown, "; ".join(unknown)
