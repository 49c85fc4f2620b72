"""Sphinx configuration. The drawings and the pages that can be read off the code are made here, at each build."""

import sys
from functools import cache
from pathlib import Path

from sphinx.addnodes import toctree

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE))

from drawings import draw_all  # noqa: E402 - found through the line above
from generated_pages import write_all  # noqa: E402
from house import write_all as write_house  # noqa: E402
from reader_tables import write_all as write_tables  # noqa: E402

import cpmkit  # noqa: E402

project = "cpmkit"
author = "The cpmkit developers"
copyright = author
version = release = cpmkit.__version__

extensions = [
    *("myst_nb", "sphinx.ext.autodoc", "sphinx.ext.napoleon", "sphinx.ext.mathjax"),
    *("sphinx.ext.viewcode", "sphinx_copybutton"),
]
exclude_patterns = ["_build", "jupyter_execute", "generated/*.md", "generated/tables/*.md"]  # pages include these
myst_enable_extensions = ["dollarmath", "colon_fence"]
myst_heading_anchors = 3
# The tutorials are executed at each build; a cell that fails, fails the build.
nb_execution_mode = "force"
nb_execution_in_temp = True
nb_execution_raise_on_error = True
nb_execution_timeout = 120
nb_merge_streams = True

html_theme = "pydata_sphinx_theme"
html_title = f"cpmkit {release}"
templates_path = ["_templates"]
html_static_path = ["_static"]
html_css_files = ["sections.css"]
html_sidebars = {"**": ["sections.html"]}
html_theme_options = {
    "show_prev_next": False,
    "navbar_center": [],  # all pages are in the sidebar, by section
    "secondary_sidebar_items": ["page-toc", "sourcelink"],
}

autodoc_typehints = "none"  # types and shapes are in the docstrings' own words
autodoc_member_order = "bysource"
napoleon_google_docstring = False
napoleon_use_param = False
napoleon_use_rtype = False
napoleon_use_ivar = True
# "(n, d) float64" names no class: only names of this project are held to exist.
suppress_warnings = ["ref.python"]  # "(n, channels)" in a docstring names no attribute, of whatever class
nitpick_ignore_regex = [("py:.*", r"(?!cpmkit).*")]


@cache
def sections(app):
    """Return the headings of the front page with the pages, (name, title) each, under them."""
    trees = app.env.get_doctree("index").findall(toctree)
    return [(tree["caption"], [(page, app.env.titles[page].astext()) for _, page in tree["entries"]]) for tree in trees]


def setup(app):
    """Give each page the sections: Sphinx would go through all headings of all pages for each of them."""
    app.connect("html-page-context", lambda app, *page: page[2].update(sections=sections(app)))


draw_all(HERE / "generated")
write_all(HERE / "generated")
write_house(HERE / "generated")
write_tables(HERE / "generated")
