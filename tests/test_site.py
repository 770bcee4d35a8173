"""The site builds without a network and a warning; its links, formulas and search work."""

import importlib
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

import spherekit as sk

ROOT = Path(__file__).parent.parent
SOME_MECHANISMS = ("four_bar", "bevel_differential")
"""Mechanisms that the site is built with here, beside those that pages link to."""
BUILD_OFFLINE = """
import socket, sys

def refuse(self, address):
    if self.family != socket.AF_UNIX and address[0] not in ("127.0.0.1", "::1"):
        raise OSError(f"the build of the site asks for {address}")
    return connect(self, address)

connect, socket.socket.connect = socket.socket.connect, refuse
from sphinx.cmd.build import main
sys.exit(main(sys.argv[1:]))
"""
"""Program that runs Sphinx, where connecting to another machine is an error."""

slow = pytest.mark.slow
SECTIONS = [
    "install",
    "tutorials/index",
    "how_to/index",
    "sections/reference",
    "sections/explanation",
    "sections/development",
]
TOCTREE = re.compile(r"^```\{toctree\}\n(.*?)^```$", re.M | re.S)


class Page(HTMLParser):
    """An HTML page, with the addresses that the tests of the site check.

    Attributes
    ----------
    links
        Addresses that the page links to.
    loads
        Addresses of images, scripts, styles and frames that the page loads.
    anchors
        Names of places in the page that links can jump to.
    """

    def __init__(self, text):
        """Read the text of the page."""
        super().__init__()
        self.links = []
        self.loads = []
        self.anchors = set()
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        """Note what a tag of HTML links to, loads, or names."""
        attributes = dict(attrs)
        for key in ("id", "name"):
            if attributes.get(key):
                self.anchors.add(attributes[key])
        if tag == "a" and attributes.get("href"):
            self.links.append(attributes["href"])
        if tag in ("img", "script", "iframe") and attributes.get("src"):
            self.loads.append(attributes["src"])
        if tag == "link" and attributes.get("rel") in ("stylesheet", "preload", "icon"):
            self.loads.append(attributes["href"])


def pages_listed_by(page):
    """Return the pages that a page of the documentation lists in its tables of contents.

    Tests follow these lists to find out whether every page can be reached. Pages are named
    by their path below `docs`, without suffix. `TOCTREE` finds the tables of contents. A
    line of a table is a name, "title <name>", or an option that begins with a colon.
    """
    text = (ROOT / "docs" / f"{page}.md").read_text("utf-8")
    children = []
    for lines in TOCTREE.findall(text):
        for line in lines.splitlines():
            is_option = line.startswith(":")
            if not line or is_option:
                continue
            name = re.sub(r".*<(.*)>", r"\1", line)  # of "title <name>"
            if name.startswith("/"):
                children.append(name[1:])
            else:
                children.append((Path(page).parent / name).as_posix())
    return children


def pages_below(page):
    """Return a page and all pages that can be reached from it by lists of children."""
    pages = [page]
    if not page.startswith("generated/"):
        for child in pages_listed_by(page):
            pages += pages_below(child)
    return pages


def test_every_page_is_in_one_of_six_sections():
    """Every written page is reached from the first one, and by one way only."""
    assert pages_listed_by("index") == SECTIONS
    docs = ROOT / "docs"
    paths = [path.relative_to(docs) for path in docs.rglob("*.md")]
    names = {path.with_suffix("").as_posix() for path in paths}
    written = {name for name in names if not name.startswith(("generated/", "paper/"))}
    reached = pages_below("index")
    assert len(reached) == len(set(reached))
    assert written == {name for name in reached if not name.startswith("generated/")}


def first_commands(path):
    """Return the first block of shell commands of a page."""
    text = (ROOT / path).read_text("utf-8")
    return re.search(r"^```sh\n(.*?)^```$", text, re.M | re.S)[1]


def test_the_front_page_has_the_commands_of_the_readme():
    assert first_commands("README.md") == first_commands("docs/index.md")


def build_site(home):
    """Build the site in a folder, and return the messages if that fails, else "".

    Nothing is asked from the network, and warnings are errors. Notebooks are not run, as
    `test_notebooks` runs them.
    """
    mechanisms = ",".join(SOME_MECHANISMS)
    command = [sys.executable, "-c", BUILD_OFFLINE, "-W", "--keep-going", "-q"]
    command += ["-D", "nb_execution_mode=off"]
    command += ["-D", "suppress_warnings=config.cache,myst-nb.lexer"]
    command += ["-b", "html", "-D", f"site_mechanisms={mechanisms}", "-j", "auto"]
    command += ["-d", str(home / "trees"), str(ROOT / "docs"), str(home / "html")]
    done = subprocess.run(command, capture_output=True, text=True, timeout=900, cwd=ROOT)
    return done.stderr[-4000:] if done.returncode else ""


@pytest.fixture(scope="module")
def site(tmp_path_factory, worker_id):
    """Return the folder of the built site; fail if Sphinx warned of anything.

    Only the first worker of pytest builds the site. The others wait and use its results.
    """
    temporary_folder = tmp_path_factory.getbasetemp()
    has_workers = worker_id != "master"
    if has_workers:
        temporary_folder = temporary_folder.parent  # common to all workers
    home = temporary_folder / "site"
    messages_file = home / "messages"
    with FileLock(f"{home}.lock"):
        if not messages_file.exists():
            messages = build_site(home)
            home.mkdir(exist_ok=True)  # it exists if Sphinx has written anything
            messages_file.write_text(messages, "utf-8")
    assert not messages_file.read_text("utf-8")
    return home / "html"


@pytest.fixture(scope="module")
def pages(site):
    """Return every page of the site by its path, but for the frames with mechanisms."""
    pages_by_path = {}
    for path in site.rglob("*.html"):
        if not {"_static", "moving"} & {*path.parts}:
            pages_by_path[path] = Page(path.read_text("utf-8"))
    return pages_by_path


@slow
def test_every_link_within_the_site_leads_to_a_file_and_an_anchor(site, pages):
    """Each link within the site leads to a file, and to a place in it if it names one.

    `pages` has the pages of the built site by path, with their links. Links to other sites
    are not followed. The final count guards against a test that finds no links.
    """
    checked_count = 0
    for path, page in pages.items():
        for link in [*page.links, *page.loads]:
            parts = urlsplit(link)
            leads_elsewhere = parts.scheme or parts.netloc
            if leads_elsewhere:
                continue
            target = (path.parent / unquote(parts.path)).resolve() if parts.path else path
            assert target.exists(), f"{path.relative_to(site)}: {link}"
            if parts.fragment and target in pages:
                assert unquote(parts.fragment) in pages[target].anchors, f"{path}: {link}"
            checked_count += 1
    assert checked_count > 1000


MOST_CLICKS = 3
"""Clicks within which each page is reached from the first one."""


@slow
def test_every_page_is_reached_in_three_clicks(site, pages):
    """Every page of the site can be reached from the first page by at most three links.

    `pages` has the pages of the built site by path, with their links, also those in menus.
    The page of search results is left out, because the search box leads to it.
    """
    reached = {site / "index.html"}
    for _ in range(MOST_CLICKS):
        for path in [*reached]:
            for link in pages[path].links:
                parts = urlsplit(link)
                if parts.path and not parts.netloc:
                    target = (path.parent / unquote(parts.path)).resolve()
                    reached |= {target} & set(pages)
    reached.add(site / "search.html")
    missed = sorted(path.relative_to(site).as_posix() for path in {*pages} - reached)
    assert not missed, missed


@slow
def test_every_page_has_the_version_and_a_link_to_the_source_code(site, pages):
    """The source code is that of the package, as the site shows it."""
    source_code = site / "_modules" / "index.html"
    assert source_code in pages
    for path, page in pages.items():
        name = path.relative_to(site).as_posix()
        assert f"spherekit {sk.__version__}" in path.read_text("utf-8"), name
        targets = {(path.parent / unquote(urlsplit(x).path)).resolve() for x in page.links}
        assert source_code in targets or path == source_code, name


FIND_FIRST_RESULT = """() => {
    const first = document.querySelector("#search-results ul.search li a");
    return first && first.href;
}"""
"""JavaScript that returns the address of the first result of a search, if there is one."""

FIRST_PAGES = {
    "install": "install",
    "gear": "tutorials/differential",
    "inverse kinematics": "inverse",
    "spring": "how_to/spring",
    "fold": "tutorials/folds",
    "workspace": "workspace",
    "assembly mode": "how_to/assembly_mode",
    "glossary": "glossary",
}
"""The page that a search for some words has to find first."""


@slow
@pytest.mark.parametrize("words", FIRST_PAGES)
def test_the_search_finds_the_right_page_first(site, browser, words):
    tab = browser.new_page()
    tab.goto(f"{(site / 'search.html').as_uri()}?q={words.replace(' ', '+')}")
    tab.wait_for_function(f"({FIND_FIRST_RESULT})()")
    tab.wait_for_timeout(1000)  # results are sorted when all are there
    address = urlsplit(tab.evaluate(FIND_FIRST_RESULT)).path
    assert address.endswith(f"/{FIRST_PAGES[words]}.html"), address
    tab.close()


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
def test_figures_of_code_have_a_version_for_each_theme(site):
    """Pages of the gallery have a light and a dark version of their figure.

    The classes `only-light` and `only-dark` of an image tell the browser which to show. The
    two files must differ. `site` is the folder of the built site.
    """
    scripts = sorted((site / "generated" / "gallery").rglob("plot_*.html"))
    assert scripts
    for page in scripts:
        images = re.findall(r"<img[^>]*>", page.read_text("utf-8"))
        sources = {
            theme: re.findall(r'src="([^"]*)"', image)
            for image in images
            for theme in ("only-light", "only-dark")
            if theme in image
        }
        assert sorted(sources) == ["only-dark", "only-light"], page
        light, dark = (
            (page.parent / source).read_bytes()
            for theme in ("only-light", "only-dark")
            for source in sources[theme]
        )
        assert light != dark


@slow
def test_the_search_has_words_of_pages_and_all_public_names(site):
    """The index of the search finds words in the text and titles of pages, and API names.

    The index stores words by their stem ("kennedi" for Kennedy), with the numbers of the
    pages that have them. `site` is the folder of the built site.
    """
    text = (site / "searchindex.js").read_text("utf-8")
    index = json.loads(re.fullmatch(r"Search\.setIndex\((.*)\);?", text.strip(), re.S)[1])
    pages = index["docnames"]
    for word, page in (
        ("eksergian", "dynamics"),
        ("kennedi", "planner"),
        ("wiper", "first_mechanism"),
    ):
        page_numbers = []
        for terms in ("terms", "titleterms"):
            numbers = index[terms].get(word, [])
            page_numbers += [numbers] if isinstance(numbers, int) else numbers
        assert pages.index(page) in page_numbers, word
    assert set(PUBLIC) <= set(index["objects"])


@slow
def test_mechanisms_have_their_page_with_numbers_and_file(site):
    for name in SOME_MECHANISMS:
        text = (site / "generated" / "mechanisms" / f"{name}.html").read_text("utf-8")
        for word in ("degrees of freedom", "assembly modes", "angle_unit", "■"):
            assert word in text, (name, word)


def sample_of_similar_pages(site, pages):
    """Return all pages, but of source code and of objects of the API only some of each."""
    similar = ("_modules/", "generated/api/")
    sample = []
    for number, path in enumerate(sorted(pages)):
        is_similar = path.relative_to(site).as_posix().startswith(similar)
        if not is_similar or number % 10 == 0 or path.stem in ("index", "plugin"):
            sample.append(path)
    return sample


FIND_CUT_ELEMENTS = """() => {
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
"""JavaScript that returns the elements of a page that are cut off at the right.

They reach beyond the window, or beyond their own frame, and cannot be scrolled.
"""


@slow
@pytest.mark.parametrize("width", [1300, 400])
def test_nothing_is_cut_off_at_the_right(site, pages, browser, width):
    """In windows of 1300 and 400 pixels. At last a page is made narrow: the check works."""
    tab = browser.new_page(viewport={"width": width, "height": 900})
    for path in sample_of_similar_pages(site, pages):
        tab.goto(path.as_uri())
        cut = tab.evaluate(FIND_CUT_ELEMENTS)
        assert not cut, f"{path.relative_to(site)}: {[text[:200] for text in cut[:3]]}"
    tab.goto((site / "python.html").as_uri())
    tab.add_style_tag(content="pre { overflow: hidden !important; width: 20rem; }")
    assert tab.evaluate(FIND_CUT_ELEMENTS)
    tab.close()


@slow
def test_mechanisms_move_in_their_pages(site, browser):
    """The picture of the sphere changes as the first input is moved by 20 key presses.

    `site` is the folder of the built site and `browser` a browser that the test controls.
    The two pages show a moving mechanism in a frame.
    """
    for page in ("index", "generated/mechanisms/five_bar"):
        tab = browser.new_page(viewport={"width": 1300, "height": 900})
        tab.goto((site / f"{page}.html").as_uri())
        frame = tab.frame_locator("iframe.moving")
        sphere = frame.locator("#sphere")
        slider = frame.locator("input[type=range]").first
        # The first press stops the motion, which would change the picture by itself.
        slider.press("ArrowRight")
        before = sphere.screenshot()
        for _ in range(20):
            slider.press("ArrowRight")
        tab.wait_for_timeout(200)
        assert sphere.screenshot() != before, page
        tab.close()


def test_a_mechanism_of_four_inputs_has_a_page(monkeypatch):
    """The script that writes the pages of mechanisms also works with four inputs.

    The number of samples on a page depends on the number of inputs. The mechanism is an
    open chain of five links in which every pair is driven.
    """
    monkeypatch.syspath_prepend(ROOT / "docs")
    mechanisms = importlib.import_module("site_pages.mechanisms")
    links = {"0": {"axes": ["p1"]}, "4": {"axes": ["p4"]}}
    for k in (1, 2, 3):
        links[str(k)] = {"axes": [f"p{k}", f"p{k + 1}"], "arcs": [50.0]}
    pairs = {f"p{k}": [str(k - 1), str(k)] for k in (1, 2, 3, 4)}
    mechanism = sk.build(
        "four_joints",
        angle_unit="deg",
        ground="0",
        links=links,
        pairs=pairs,
        inputs=list(pairs),
    )
    page = mechanisms._page(mechanism, file="")
    assert page.startswith("# four_joints")
