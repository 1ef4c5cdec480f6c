"""Sphinx configuration of the documentation site, built by `make docs` into output/docs."""

from __future__ import annotations

import re
import sys
import xml.etree.ElementTree as ElementTree
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from sphinx.application import Sphinx

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

project = 'aerarm_ros'
author = 'aerarm_ros developers'
copyright = author
version = release = ElementTree.parse(ROOT / 'package.xml').getroot().findtext('version') or ''

extensions = [
    'myst_parser',
    'sphinx.ext.autodoc',
    'sphinx.ext.autosummary',
    'numpydoc',
    'sphinx_copybutton',
]
# README.md is the list of all pages, which index.md includes.
exclude_patterns = ['README.md']
# Notebooks and configuration are files to download, not pages.
myst_heading_anchors = 4
myst_enable_extensions = ['dollarmath']
myst_dmath_allow_digits = False
autodoc_typehints = 'none'
autosummary_generate = False
numpydoc_show_class_members = False
# A shell prompt or Python's is not part of what a reader copies.
copybutton_prompt_text = r'>>> |\$ '
copybutton_prompt_is_regexp = True
nitpicky = False

html_theme = 'furo'
html_title = f'aerarm_ros {version}'
html_static_path = ['_static']
html_css_files = ['wide.css']
html_show_sourcelink = False
html_theme_options = {'top_of_page_buttons': []}

LINK = re.compile(r'^\s*- \[[^\]]*\]\(([^)#\s]+)\.(?:md|rst)\)', re.MULTILINE)


def add_contents(app: Sphinx, page: str, source: list[str]) -> None:
    """Append the table of contents of the sections and links of README.md to the start page."""
    if page != 'index':
        return
    _, *sections = re.split(r'^## ', (Path(app.srcdir) / 'README.md').read_text(), flags=re.M)
    for section in sections:
        title, _, text = section.partition('\n')
        pages = '\n'.join(LINK.findall(text))
        if pages:
            source[0] += f'\n```{{toctree}}\n:hidden:\n:caption: {title}\n\n{pages}\n```\n'


def setup(app: Sphinx) -> None:
    """Connect the hook that fills the table of contents."""
    app.connect('source-read', add_contents)
