"""The site builds without a network and a warning; its links, formulas and search work."""

import json
import re
import subprocess
import sys
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlsplit

import pytest
from filelock import FileLock
from helpers.public_packages import PUBLIC

ROOT = Path(__file__).parent.parent
SOME = ("four_bar", "bevel_differential")
"""Mechanisms that the site is built with here, beside those that pages link to."""
OFFLINE = """
import socket, sys

def refuse(self, address):
    if self.family != socket.AF_UNIX and address[0] not in ("127.0.0.1", "::1"):
        raise OSError(f"the build of the site asks for {address}")
    return connect(self, address)

connect, socket.socket.connect = socket.socket.connect, refuse
from sphinx.cmd.build import main
sys.exit(main(sys.argv[1:]))
"""

slow = pytest.mark.slow
SECTIONS = ("start", "examples", "guide", "methods", "reference")
TOCTREE = re.compile(r"^```\{toctree\}\n(.*?)^```$", re.M | re.S)


class Page(HTMLParser):
    """What a page links to, loads, and can be jumped to."""

    def __init__(self, text):
        super().__init__()
        self.links, self.loads, self.anchors = [], [], set()
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        named = dict(attrs)
        self.anchors |= {named[key] for key in ("id", "name") if named.get(key)}
        if tag == "a" and named.get("href"):
            self.links.append(named["href"])
        if tag in ("img", "script", "iframe") and named.get("src"):
            self.loads.append(named["src"])
        if tag == "link" and named.get("rel") in ("stylesheet", "preload", "icon"):
            self.loads.append(named["href"])


def listed(page):
    """The pages that a page's toctrees list, from the folder of the pages."""
    home = ROOT / "docs"
    entries = [
        re.sub(r".*<(.*)>", r"\1", line)
        for lines in TOCTREE.findall((home / f"{page}.md").read_text("utf-8"))
        for line in lines.splitlines()
        if line and line[0] != ":"
    ]
    folder = Path(page).parent
    return [name[1:] if name[0] == "/" else (folder / name).as_posix() for name in entries]


def below(page):
    if page.startswith("generated/"):
        return [page]
    return [page, *(name for child in listed(page) for name in below(child))]


def test_every_page_is_in_one_of_five_sections():
    assert listed("index") == [f"sections/{name}" for name in SECTIONS]
    docs = ROOT / "docs"
    written = {
        path.relative_to(docs).with_suffix("").as_posix() for path in docs.rglob("*.md")
    }
    written = {name for name in written if not name.startswith(("generated/", "paper/"))}
    reached = below("index")
    assert len(reached) == len(set(reached))
    assert written == {name for name in reached if not name.startswith("generated/")}


def test_the_front_page_has_the_commands_of_the_readme():
    first = [
        re.search(r"^```sh\n(.*?)^```$", (ROOT / path).read_text("utf-8"), re.M | re.S)[1]
        for path in ("README.md", "docs/index.md")
    ]
    assert first[0] == first[1]


@pytest.fixture(scope="module")
def site(tmp_path_factory, worker_id):
    """The site as it is built from nothing, without a network, warnings being errors.

    Workers of one session share it, and what was wrong with it.
    """
    shared = tmp_path_factory.getbasetemp()
    home = (shared if worker_id == "master" else shared.parent) / "site"
    said = home / "said"
    with FileLock(f"{home}.lock"):
        if not said.exists():
            command = [sys.executable, "-c", OFFLINE, "-W", "--keep-going", "-q"]
            command += ["-D", "nb_execution_mode=off"]  # test_notebooks runs them
            command += ["-D", "suppress_warnings=config.cache,myst-nb.lexer"]
            command += ["-b", "html", "-D", f"site_mechanisms={','.join(SOME)}"]
            command += [
                "-j",
                "auto",
                "-d",
                str(home / "trees"),
                str(ROOT / "docs"),
                str(home / "html"),
            ]
            built = subprocess.run(
                command, capture_output=True, text=True, timeout=900, cwd=ROOT
            )
            said.parent.mkdir(exist_ok=True)
            said.write_text(built.stderr[-4000:] if built.returncode else "", "utf-8")
    assert not said.read_text("utf-8")
    return home / "html"


@pytest.fixture(scope="module")
def pages(site):
    found = [x for x in site.rglob("*.html") if not {"_static", "moving"} & {*x.parts}]
    return {path: Page(path.read_text("utf-8")) for path in found}


@slow
def test_every_link_within_the_site_leads_somewhere(site, pages):
    checked = 0
    for path, page in pages.items():
        for link in [*page.links, *page.loads]:
            parts = urlsplit(link)
            if parts.scheme or parts.netloc:
                continue
            target = (path.parent / unquote(parts.path)).resolve() if parts.path else path
            assert target.exists(), f"{path.relative_to(site)}: {link}"
            if parts.fragment and target in pages:
                assert unquote(parts.fragment) in pages[target].anchors, f"{path}: {link}"
            checked += 1
    assert checked > 1000


@slow
def test_pages_load_nothing_from_elsewhere(site, pages):
    for path, page in pages.items():
        for load in page.loads:
            assert not urlsplit(load).netloc, f"{path.relative_to(site)}: {load}"


@slow
def test_formulas_have_their_renderer(site, pages):
    theory = pages[site / "theory.html"]
    (renderer,) = [load for load in theory.loads if "mathjax" in load.lower()]
    assert (site / urlsplit(renderer).path).stat().st_size > 100_000
    assert 'class="math' in (site / "theory.html").read_text("utf-8")


@slow
def test_search_knows_words_and_names(site):
    text = (site / "searchindex.js").read_text("utf-8")
    index = json.loads(re.fullmatch(r"Search\.setIndex\((.*)\);?", text.strip(), re.S)[1])
    pages = index["docnames"]
    for word, page in (
        ("eksergian", "dynamics"),
        ("kennedi", "planner"),
        ("wiper", "first_mechanism"),
    ):
        found = [index[terms].get(word, []) for terms in ("terms", "titleterms")]
        numbers = {n for part in found for n in ([part] if isinstance(part, int) else part)}
        assert pages.index(page) in numbers, word
    assert set(PUBLIC) <= set(index["objects"])


@slow
def test_mechanisms_have_their_page_with_numbers_and_file(site):
    for name in SOME:
        text = (site / "generated" / "mechanisms" / f"{name}.html").read_text("utf-8")
        for asked in ("mobility", "assembly modes", "angle_unit", "■"):
            assert asked in text, (name, asked)


CUT = """() => {
    const scrolls = at => !at.matches(".bd-article") &&
        (/auto|scroll/.test(getComputedStyle(at).overflowX) || scrolls(at.parentElement));
    const wide = at => at.getBoundingClientRect().right > innerWidth + 1
        || at.matches("pre") && at.scrollWidth > at.clientWidth + 1;
    const shown = [...document.querySelectorAll(".bd-article *")];
    const cut = shown.filter(at => wide(at) && !scrolls(at)).map(at => at.outerHTML);
    for (const all of document.querySelectorAll("html, .bd-article-container"))
        if (all.scrollWidth > all.clientWidth) cut.push(all.tagName);
    return cut;
}"""


@slow
@pytest.mark.parametrize("width", [1300, 400])
def test_nothing_is_cut_off_at_the_right(site, pages, browser, width):
    tab = browser.new_page(viewport={"width": width, "height": 900})
    for path in pages:
        tab.goto(path.as_uri())
        cut = tab.evaluate(CUT)
        assert not cut, f"{path.relative_to(site)}: {[x[:200] for x in cut[:3]]}"
    tab.goto((site / "python.html").as_uri())
    tab.add_style_tag(content="pre { overflow: hidden !important; width: 20rem; }")
    assert tab.evaluate(CUT)
    tab.close()


@slow
def test_mechanisms_move_in_their_pages(site, browser):
    for page in ("index", "generated/mechanisms/five_bar"):
        tab = browser.new_page(viewport={"width": 1300, "height": 900})
        tab.goto((site / f"{page}.html").as_uri())
        frame = tab.frame_locator("iframe.moving")
        sphere, driven = frame.locator("#sphere"), frame.locator("input[type=range]").first
        driven.press("ArrowRight")
        before = sphere.screenshot()
        for _ in range(20):
            driven.press("ArrowRight")
        tab.wait_for_timeout(200)
        assert sphere.screenshot() != before, page
        tab.close()
