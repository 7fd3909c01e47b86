"""Configuration of the documentation: `make docs` builds it into docs/_build/html."""

import sys
from pathlib import Path
from typing import Any

from docutils import nodes
from latex2mathml.converter import convert
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

extensions = ["myst_nb", "numpydoc", "sphinx.ext.autodoc"]
html_math_renderer = "mathml"
myst_update_mathjax = False
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
html_sidebars = {
    name: [] for name in ("index", "install", "first-half-hour", "soundtrap-folder", "notebook")
}


def write_inline_math(translator: Any, node: nodes.math) -> None:
    """Write a formula as MathML, which browsers draw by themselves: no script."""
    translator.body.append(convert(node.astext()))
    raise nodes.SkipNode


def write_block_math(translator: Any, node: nodes.math_block) -> None:
    """Write a formula of its own line as MathML."""
    translator.body.append(f"<p>{convert(node.astext(), display='block')}</p>")
    raise nodes.SkipNode


def setup(app: Sphinx) -> None:
    """Draw formulas without a script from elsewhere, and run the notebook each time.

    What the notebook shows may have changed.
    """
    app.add_html_math_renderer("mathml", (write_inline_math, None), (write_block_math, None))
    app.connect("env-get-outdated", lambda *_: ["notebook"])
