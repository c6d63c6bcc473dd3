"""Words of art: the first one of each on a page of the site leads to the glossary.

The glossary is `docs/glossary.md`: a heading of the third level for each word, and other forms of it in a comment
beneath, `<!-- also: thresholds -->`. A word that has other senses as well is found in some forms alone,
`<!-- only as: finger load -->`.
"""

import re
from pathlib import Path

from docutils import nodes

ROOT = Path(__file__).resolve().parents[2]
GLOSSARY = "docs/glossary"
#: Where a word is not linked: it is a link, a heading, code or a caption already.
WITHIN = (nodes.reference, nodes.title, nodes.literal, nodes.literal_block, nodes.caption, nodes.raw)


def glossary(text):
    """Return, for every form of every word, the heading that it leads to and the first sentence beneath it."""
    forms = {}
    for part in re.split(r"^### ", text, flags=re.MULTILINE)[1:]:
        head, _, body = part.partition("\n")
        more = re.search(r"<!-- (also|only as): (.*?) -->", body, re.DOTALL)
        forms_here = re.split(r",\s*", more[2]) if more else []
        forms_here += [] if more and more[1] == "only as" else [head.strip()]
        words = re.sub(r"<!--.*?-->", "", body, flags=re.DOTALL).split()
        told = re.match(r".*?[.;:](?=\s|$)|.*", " ".join(words))[0]
        forms.update({form: (head.strip(), told) for form in forms_here})
    return forms


def anchor(head):
    """Return the anchor that a heading has in its page."""
    return re.sub(r"[^\w\- ]", "", head.lower()).strip().replace(" ", "-")


def pattern(forms):
    """Return the expression that finds any form of a word of art, the longest first; capitals do not count."""
    longest = sorted(forms, key=len, reverse=True)
    words = "|".join(re.escape(form).replace(r"\ ", r"\s+") for form in longest)
    return re.compile(rf"(?<![\w-])(?:{words})(?![\w-])", re.IGNORECASE)


def _link_first(app, tree, page):
    if page in (GLOSSARY, "CHANGELOG") or page.startswith("docs/python/"):
        return
    forms = {form.lower(): told for form, told in app.tactuator_forms.items()}
    find, linked = pattern(forms), set()
    place = app.builder.get_relative_uri(page, GLOSSARY)
    for text in list(tree.findall(nodes.Text)):
        if not any(isinstance(parent, WITHIN) for parent in _parents(text)):
            _link_within(text, find, forms, linked, place)


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
    """Link words of art when a page is written."""
    app.tactuator_forms = glossary((ROOT / f"{GLOSSARY}.md").read_text(encoding="utf-8"))
    app.connect("doctree-resolved", _link_first)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
