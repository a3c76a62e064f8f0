"""Settings of the documentation site: ``make docs`` builds it from the pages in this folder."""

from __future__ import annotations

import os
import re
from pathlib import Path

from pygments.lexers.special import TextLexer
from sphinx.application import Sphinx

from bayes_asv import __version__

ROOT = Path(__file__).parents[1]
# The notebooks run in processes and folders of their own, and take their drawings from here.
os.environ["PYTHONPATH"] = str(ROOT / "docs")

project = "bayes_asv"
author = "The bayes_asv authors"
copyright = f"2026, {author}"  # the name is Sphinx's
version = release = __version__

extensions = [
    "myst_nb",
    "numpydoc",
    "sphinx.ext.autodoc",
    "sphinx_copybutton",
    "sphinx_design",
    "sphinx-mathjax-offline",  # the pages load nothing from other servers
]
exclude_patterns = ["_build"]

myst_enable_extensions = ["dollarmath", "colon_fence", "deflist"]
myst_heading_anchors = 4
nb_execution_mode = "cache"
nb_execution_in_temp = True
nb_execution_timeout = 300
nb_execution_raise_on_error = True
nb_mime_priority_overrides = [("html", "text/html", 0)]

autodoc_typehints = "none"  # numpydoc shows the types of the docstrings
numpydoc_show_class_members = True
numpydoc_show_inherited_class_members = True
numpydoc_class_members_toctree = False

html_theme = "pydata_sphinx_theme"
html_title = f"bayes_asv {version}"
html_static_path = ["_static"]
html_css_files = ["site.css"]
html_show_sourcelink = False
html_theme_options = {
    "logo": {"text": "bayes_asv"},
    "navigation_with_keys": False,
    "navbar_align": "left",
    "header_links_before_dropdown": 6,
    "show_toc_level": 2,
    "secondary_sidebar_items": ["page-toc"],
    "footer_start": ["copyright"],
    "footer_end": ["theme-version"],
}
copybutton_exclude = ".linenos, .gp, .go"


# Files of other folders that are pages of the site, each in the place of a page that is empty.
_ELSEWHERE = {
    "firmware": "firmware/README.md",
    "protocol": "firmware/PROTOCOL.md",
    "benchmarks": "benchmarks/README.md",
    "changelog": "CHANGELOG.md",
    "contributing": "CONTRIBUTING.md",
    "conduct": "CODE_OF_CONDUCT.md",
}


def _take_from_elsewhere(app: Sphinx, page: str, content: list[str]) -> None:
    """Fill the pages that stand for files of other folders, and let links lead to them."""
    if page in _ELSEWHERE:
        content[0] = (ROOT / _ELSEWHERE[page]).read_text(encoding="utf-8")
    for name, file in _ELSEWHERE.items():
        for written in (f"../{file}", Path(file).name if page in _ELSEWHERE else f"../{file}"):
            content[0] = content[0].replace(f"]({written}", f"]({name}.md")
    if page in _ELSEWHERE:
        content[0] = re.sub(r"\]\((?:\.\./)?docs/", "](", content[0])


def setup(app: Sphinx) -> None:
    """Connect what this file adds to Sphinx."""
    app.connect("source-read", _take_from_elsewhere)
    app.add_lexer("golden", TextLexer)  # frames of the logger's protocol
