"""Settings of the documentation site: `make site` builds it from the repository's own Markdown."""

import sys
from importlib.metadata import version as version_of
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

project = "tactuator"
version = release = version_of("tactuator")
copyright = "the tactuator contributors, BSD-3-Clause"

extensions = [
    "myst_parser",
    "sphinx.ext.autodoc",
    "tools.pages.navigation",
    "tools.pages.executed",
    "tools.pages.terms",
    "tools.pages.python_reference",
]
root_doc = "README"
include_patterns = ["*.md", "docs/*.md", "docs/**/*.md"]
exclude_patterns = ["docs/site", "out", "build", "src", "tests", "core", "firmware", "benchmarks", ".*"]
myst_heading_anchors = 4
autodoc_member_order = "bysource"
autodoc_typehints = "signature"
autodoc_use_type_comments = False  # there are none, and looking for them means parsing every function again
python_maximum_signature_line_length = 90
toc_object_entries = False
nitpicky = False

# Nothing is loaded from a network: system fonts, the theme's own scripts, a search index that is a file.
html_theme = "pydata_sphinx_theme"
html_title = "tactuator"
html_static_path = ["static"]
html_css_files = ["tactuator.css"]
html_show_sourcelink = False
html_copy_source = False
html_context = {"default_mode": "auto"}
html_theme_options = {
    "logo": {"text": "tactuator"},
    "navbar_align": "left",
    "header_links_before_dropdown": 7,
    "show_toc_level": 2,
    "secondary_sidebar_items": ["page-toc"],
    "footer_start": ["copyright"],
    "footer_end": [],
    "pygments_light_style": "a11y-high-contrast-light",
    "pygments_dark_style": "a11y-high-contrast-dark",
}
