"""The glossary, `docs/glossary.md`: which words are in it, and how they are found in a text.

It has a heading of the third level for each term, and other forms of it in a comment beneath,
`<!-- also: threshold -->`; plurals in -s are found too. A term that has other senses as well is found in some forms
alone, `<!-- only as: finger load -->`.
"""

import re


def glossary(text):
    """Return, for every form of every word, the heading that it leads to and the first sentence beneath it."""
    forms = {}
    for part in re.split(r"^### ", text, flags=re.MULTILINE)[1:]:
        head, _, body = part.partition("\n")
        more = re.search(r"<!-- (also|only as): (.*?) -->", body, re.DOTALL)
        forms_here = re.split(r",\s*", more[2]) if more else []
        if not (more and more[1] == "only as"):
            forms_here.append(head.strip())
            forms_here += [f"{form}s" for form in forms_here]
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
