"""Configuration of the documentation: `make docs` builds it into docs/_build/html."""

import sys
from pathlib import Path

from sphinx.application import Sphinx

import uwtrack_cli

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE))

from reference_pages import write_reference

write_reference(HERE / "reference" / "generated")

project = "uwtrack"
author = "the uwtrack authors"
copyright = author  # noqa: A001 - Sphinx's name
version = release = uwtrack_cli.__version__

extensions = [
    "myst_nb",
    "numpydoc",
    "sphinx.ext.autodoc",
    "sphinx.ext.mathjax",
]
exclude_patterns = ["_build"]
smartquotes = False  # options begin with two hyphens
numpydoc_show_class_members = False
autodoc_typehints = "none"  # the sections of the docstrings tell them
autodoc_member_order = "bysource"
myst_enable_extensions = ["dollarmath", "colon_fence"]
myst_heading_anchors = 3
nb_execution_mode = "force"
nb_execution_raise_on_error = True
nb_execution_timeout = 300
nb_execution_in_temp = True
nb_merge_streams = True

html_theme = "pydata_sphinx_theme"
html_title = f"uwtrack {release}"
html_static_path = ["_static"]
html_css_files = ["wide.css"]
html_theme_options = {
    "show_toc_level": 2,
    "navigation_with_keys": False,
    "secondary_sidebar_items": ["page-toc"],
}
html_sidebars = {name: [] for name in ("index", "install", "tutorial", "notebook")}


def setup(app: Sphinx) -> None:
    """Run the notebook in every build: what it shows may have changed."""
    app.connect("env-get-outdated", lambda *_: ["notebook"])
