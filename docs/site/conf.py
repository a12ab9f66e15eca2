"""Sphinx's settings for the documents as a site: `make docs`.

The source is the whole checkout, of which the Markdown documents are pages, so that every link between them
is the same on the site and in the repository.
"""

from importlib.metadata import version as installed_version

from sphinx.application import Sphinx

project = "hand_recon"
author = "The hand_recon authors"
version = release = installed_version("hand_recon")

extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon"]
root_doc = "docs/index"
include_patterns = [
    "docs/*.md",
    "docs/decisions/*.md",
    "data/README.md",
    "README.md",
    "CONTRIBUTING.md",
    "SECURITY.md",
    "CHANGELOG.md",
]
# The records of decisions are reached from their index; a test checks that every other page is in the menu.
suppress_warnings = ["toc.not_included"]

# Links to headings, as deep as the documents have them, with the anchors that code hosts give.
myst_heading_anchors = 4
myst_links_external_new_tab = True
# Indented blocks in the documents are shell commands or file listings, with … for what a reader fills in.
highlight_language = "none"
# Single backticks in docstrings are code.
default_role = "code"
add_module_names = False

autodoc_default_options = {"members": True, "show-inheritance": False}
autodoc_typehints = "signature"
autodoc_member_order = "bysource"
napoleon_google_docstring = True
napoleon_numpy_docstring = False

html_theme = "furo"
html_title = "hand_recon"
html_copy_source = False
html_show_sphinx = False
html_show_copyright = False
# The page that leads from the site's address to its start.
html_extra_path = ["start"]

FIELDS = frozenset({"attribute", "data", "property"})
"""Kinds of objects whose docstrings are sentences, in which a colon does not end a type."""

_sentences: dict[str, list[str]] = {}


def setup(app: Sphinx) -> None:
    """Keep docstrings of fields as they are; Napoleon takes what is before a colon for a type."""
    app.connect("autodoc-process-docstring", _keep, priority=400)
    app.connect("autodoc-process-docstring", _restore, priority=600)


def _keep(
    _app: Sphinx, what: str, name: str, _value: object, _options: object, lines: list[str]
) -> None:
    if what in FIELDS:
        _sentences[name] = list(lines)


def _restore(
    _app: Sphinx,
    what: str,
    name: str,
    _value: object,
    _options: object,
    lines: list[str],
) -> None:
    if what in FIELDS:
        lines[:] = _sentences.pop(name)
