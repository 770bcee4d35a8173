"""How Sphinx builds the site: ``python -m sphinx -j auto -W -b html docs build/site``."""

import os
import sys
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # processes side by side instead
sys.path.insert(0, str(Path(__file__).parent))

from spherekit import __version__

project = "spherekit"
author = "The spherekit authors"
project_copyright = "The spherekit authors, BSD-3-Clause"
version = release = __version__

extensions = [
    "sphinx.ext.autodoc",
    "sphinx.ext.mathjax",
    "sphinx.ext.viewcode",
    "sphinx-mathjax-offline",
    "numpydoc",
    "myst_nb",
    "sphinx_copybutton",
    "sphinx_design",
    "sphinx_gallery.gen_gallery",
    "site_pages",
]
exclude_patterns = [
    "_build",
    "paper",
    "gallery",
    "generated/extra",
    "generated/messages",
    "generated/files",
    "generated/gallery/**.ipynb",
    "**.ipynb_checkpoints",
]

myst_enable_extensions = ["colon_fence", "dollarmath", "deflist"]
myst_heading_anchors = 4
smartquotes = False  # would turn the mode -- and options into dashes
nb_execution_mode = "force"
nb_execution_timeout = 120
nb_execution_raise_on_error = True

autodoc_typehints = "signature"
autodoc_typehints_format = "short"
toc_object_entries_show_parents = "hide"
python_maximum_signature_line_length = 88
numpydoc_show_class_members = False

sphinx_gallery_conf = {
    "examples_dirs": ["gallery"],
    "gallery_dirs": ["generated/gallery"],
    "subsection_order": [
        f"gallery/{part}"
        for part in ("sphere", "coefficients", "singularities", "dynamics")
    ],
    "within_subsection_order": "FileNameSortKey",
    "thumbnail_size": (640, 320),
    "filename_pattern": "plot_",
    "image_scrapers": ("site_pages.gallery.last_figure",),
    "capture_repr": ("_repr_html_",),
    "download_all_examples": False,
    "show_memory": False,
    "show_signature": False,
    "abort_on_example_error": True,
    "min_reported_time": 1e9,
    "write_computation_times": False,
    "notebook_extensions": set(),
}
suppress_warnings = ["config.cache"]

copybutton_exclude = ".linenos, .gp, .go"
html_theme = "pydata_sphinx_theme"
html_title = "spherekit"
html_logo = html_favicon = "_static/logo.svg"
templates_path = ["_templates"]
html_static_path = ["_static"]
html_css_files = ["site.css"]
html_js_files = ["site.js"]
html_extra_path = ["generated/extra"]
html_search_scorer = str(Path(__file__).parent / "_static" / "search_scorer.js")
html_copy_source = False
html_show_sourcelink = False
html_sidebars = {"**": ["sidebar-nav-bs"], "index": []}
html_theme_options = {
    "logo": {"text": f"spherekit {version}"},
    "navbar_align": "left",
    "header_links_before_dropdown": 6,
    "navigation_with_keys": False,
    "navigation_depth": 3,
    "secondary_sidebar_items": ["page-toc"],
    "show_prev_next": True,
    "footer_start": ["copyright"],
    "navbar_end": ["source-code", "theme-switcher"],
    "footer_end": ["source-code"],
}
