"""Words of art: the first one of each on a page of the site leads to the glossary."""

from functools import cache
from pathlib import Path

from docutils import nodes
from sphinx.search.en import SearchEnglish

from tools.pages.glossary import anchor, glossary, pattern

ROOT = Path(__file__).resolve().parents[2]
GLOSSARY = "docs/glossary"
#: Where a word is not linked: it is a link, a heading, code or a caption already.
WITHIN = (nodes.reference, nodes.title, nodes.literal, nodes.literal_block, nodes.caption, nodes.raw)


class StemsOnce(SearchEnglish):
    """English for the search, each word stemmed once: a word stands on many pages."""

    @cache  # noqa: B019 (there is one of it, and it lives until the end)
    def stem(self, word):
        """Return the stem of a word."""
        return super().stem(word)


def _link_first(app, tree, page):
    if page in (GLOSSARY, "CHANGELOG") or page.startswith("docs/python/"):
        return
    forms = {form.lower(): told for form, told in app.tactuator_forms.items()}
    find, linked = pattern(forms), set()
    place = app.builder.get_relative_uri(page, GLOSSARY)
    _join_lines(tree)
    for text in list(tree.findall(nodes.Text)):
        if not any(isinstance(parent, WITHIN) for parent in _parents(text)):
            _link_within(text, find, forms, linked, place)


def _join_lines(tree):
    """Make one text of neighbours: a line end in the source parts a word of art into two."""
    for parent in list(tree.findall(nodes.TextElement)):
        joined = []
        for child in parent.children:
            if joined and isinstance(child, nodes.Text) and isinstance(joined[-1], nodes.Text):
                joined[-1] = nodes.Text(joined[-1].astext() + child.astext())
            else:
                joined.append(child)
        if len(joined) < len(parent.children):
            parent[:] = joined


def _parents(node):
    while node.parent is not None:
        node = node.parent
        yield node


def _link_within(text, find, forms, linked, place):
    """Replace the words of one text that are the first of their kind on the page."""
    parts, at, whole = [], 0, text.astext()
    for match in find.finditer(whole):
        head, told = forms[" ".join(match[0].lower().split())]
        if head in linked:
            continue
        linked.add(head)
        link = nodes.reference("", match[0], internal=True, refuri=f"{place}#{anchor(head)}", reftitle=told)
        link["classes"].append("term")
        parts += [nodes.Text(whole[at : match.start()]), link]
        at = match.end()
    if parts:
        text.parent.replace(text, [*parts, nodes.Text(whole[at:])])


def setup(app):
    """Link words of art when a page is written, and stem what is searched for."""
    app.add_search_language(StemsOnce)
    app.tactuator_forms = glossary((ROOT / f"{GLOSSARY}.md").read_text(encoding="utf-8"))
    app.connect("doctree-resolved", _link_first)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
