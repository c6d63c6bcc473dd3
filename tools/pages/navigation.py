"""The site's navigation, read from the pages themselves: a list page's bullets and rows are its entries.

So that the same Markdown serves a reader of the repository and the site, no page has a table of contents for Sphinx.
"""

import os
import re
from pathlib import Path, PurePosixPath

ROOT = Path(__file__).resolve().parents[2]
START = "README"
#: Pages that list others, in the order in which they may claim a page; the start page takes what is left.
LISTS = (
    "docs/tutorials/README", "docs/how-to", "docs/reference", "docs/explanation", "docs/decisions/README", START,
)  # fmt: skip
ENTRY = re.compile(r"^(?:- |\| )\[[^\]]*\]\(([^)#:]+)\.md\)", re.MULTILINE)
FIRST_PAGE = '<!doctype html><title>tactuator</title><meta http-equiv="refresh" content="0; url=README.html">\n'


def entries(page, text):
    """Return the pages that a list page names at the head of a bullet or a row, in its order."""
    folder = PurePosixPath(page).parent
    return list(dict.fromkeys(os.path.normpath(folder / link) for link in ENTRY.findall(text)))


def contents(texts):
    """Return the entries of every list page, given their texts; each page stands under one of them."""
    owned, found = {START}, {}
    for page in LISTS:
        found[page] = [entry for entry in entries(page, texts[page]) if entry not in owned]
        owned.update(found[page])
    return found


def _add_contents(app, page, source):
    if page in LISTS:
        texts = {name: (ROOT / f"{name}.md").read_text(encoding="utf-8") for name in LISTS}
        listed = contents(texts | {page: source[0]})[page]
        names = "\n".join("/" + entry for entry in listed)
        source[0] += f"\n\n```{{toctree}}\n:hidden:\n:maxdepth: 1\n\n{names}\n```\n"


def _write_first_page(app, fault):
    if fault is None:
        (Path(app.outdir) / "index.html").write_text(FIRST_PAGE, encoding="ascii")


def setup(app):
    """Give the pages that list others their place in the navigation."""
    app.connect("source-read", _add_contents, priority=900)
    app.connect("build-finished", _write_first_page)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
