"""The site: every page is reached in two clicks, no link is dead, nothing comes from a network."""

import re
import subprocess
import sys
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlsplit

import pytest

from tools.pages.blocks import Block
from tools.pages.executed import with_outputs
from tools.pages.glossary import anchor, glossary, pattern
from tools.pages.navigation import LISTS, START, contents, entries
from tools.pages.run import Said

ROOT = Path(__file__).resolve().parents[2]
PAGES = {
    str(path.relative_to(ROOT).with_suffix(""))
    for path in [*ROOT.glob("*.md"), *(ROOT / "docs").rglob("*.md")]
    if not path.is_relative_to(ROOT / "docs" / "python")
}


def links_of(page: str) -> set[str]:
    """The pages of the repository that a page links to."""
    text = (ROOT / f"{page}.md").read_text(encoding="utf-8")
    targets = re.findall(r"\]\(([^)#:\s]+)\.md(?:#[^)]*)?\)", text)
    return {str((ROOT / f"{page}.md").parent.joinpath(link).resolve().relative_to(ROOT)) for link in targets}


def within_two_clicks(links: dict[str, set[str]]) -> set[str]:
    first = links[START]
    return {START} | first | set().union(*(links.get(page, set()) for page in first))


def test_pages__every_one__is_within_two_clicks_of_the_readme():
    links = {page: links_of(page) for page in PAGES}
    assert sorted(PAGES - within_two_clicks(links)) == []
    chain = {START: {"a"}, "a": {"b"}, "b": {"c"}, "c": set()}
    assert set(chain) - within_two_clicks(chain) == {"c"}


def test_contents__every_page__stands_once_in_the_navigation():
    texts = {name: (ROOT / f"{name}.md").read_text(encoding="utf-8") for name in LISTS}
    listed = [page for pages in contents(texts).values() for page in pages]
    assert len(listed) == len(set(listed))
    assert {START, *listed} == PAGES


def test_entries__bullets_and_rows__are_taken_and_other_links_are_not():
    text = "- [a](a.md): words\n| [b](../b.md#part) | x |\n| [c](../c.md) | x |\nsee [d](d.md)\n- [e](https://x/e.md)\n"
    assert entries("docs/list", text) == ["docs/a", "c"]


def test_glossary__every_form__leads_to_a_heading_with_a_sentence():
    forms = glossary((ROOT / "docs/glossary.md").read_text(encoding="utf-8"))
    assert len(forms) > 100
    assert {"dB SL", "threshold curves", "prefilter"} <= set(forms)
    assert [form for form, (_, told) in forms.items() if len(told.split()) < 3] == []
    assert "load" not in forms  # it has other senses: found as "finger load" alone
    assert anchor("dB re 1 µm") == "db-re-1-µm"


def test_pattern__longest_form__wins_across_lines_and_capitals():
    find = pattern(["threshold", "detection threshold", "C"])
    assert [match[0] for match in find.finditer("Detection\nthreshold, thresholds, sub-threshold, C-like")] == [
        "Detection\nthreshold"
    ]


def test_with_outputs__what_a_block_said__stands_after_it(tmp_path):
    text = "a\n\n```sh\nls\n```\nb\n"
    shown = with_outputs(text, [Said("ls", "x.csv\n", 5)], tmp_path)
    assert shown.index("```sh") < shown.index("x.csv") < shown.index("\nb")
    assert ":class: output" in shown
    assert Block("sh", "ls", 3, 5, {}).runs


class Page(HTMLParser):
    """The ids and the links of a page of the site, and what it loads."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.ids: set[str] = set()
        self.links: list[str] = []
        self.loads: list[str] = []
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        found = dict(attrs)
        self.ids |= {found[key] for key in ("id", "name") if found.get(key)}
        if tag == "a" and found.get("href"):
            self.links.append(found["href"])
        self.loads += [found[key] for key in ("src", "srcset", "data") if found.get(key)]
        if tag == "link" and found.get("rel") not in ("next", "prev", "index", "search", "canonical"):
            self.loads.append(found.get("href") or "")


def faults(site: Path) -> list[str]:
    """Dead links and anchors of a site, and whatever a page of it would load from elsewhere."""
    pages = {
        path: Page(path.read_text(encoding="utf-8")) for path in site.rglob("*.html") if "_static" not in path.parts
    }
    found = []
    for path, page in pages.items():
        for link in [*page.links, *page.loads]:
            parts = urlsplit(link)
            target = (path.parent / unquote(parts.path)).resolve() if parts.path else path
            if parts.scheme in ("http", "https") or parts.netloc:
                found += [f"{path.name} loads {link}"] if link in page.loads else []
            elif parts.scheme not in ("mailto", "data", "javascript"):
                if not target.exists():
                    found.append(f"{path.relative_to(site)}: no {link}")
                elif parts.fragment and target in pages and unquote(parts.fragment) not in pages[target].ids:
                    found.append(f"{path.relative_to(site)}: no anchor {link}")
    for sheet in site.rglob("*.css"):
        found += [
            f"{sheet.name} loads {url}"
            for url in re.findall(r"(?:url\(|@import )[\"']?(https?://[^\"')]*)", sheet.read_text("utf-8"))
        ]
    return found


def test_faults__page_with_one__is_found(tmp_path):
    sound = '<p id="here"><a href="#here">x</a> <a href="https://example.org">y</a>'
    for html, words in (
        ('<a href="b.html">', "no b.html"),
        ('<a href="#nowhere">', "no anchor #nowhere"),
        ('<script src="https://cdn.example/x.js"></script>', "loads https://cdn.example/x.js"),
        ('<link rel="stylesheet" href="https://fonts.example/x.css">', "loads https://fonts.example/x.css"),
        ('<img src="gone.svg">', "no gone.svg"),
    ):
        (tmp_path / "a.html").write_text(sound + html)
        assert [words in fault for fault in faults(tmp_path)] == [True], html


@pytest.mark.slow
def test_site__as_make_builds_it__has_no_dead_link_and_loads_nothing_from_a_network(tmp_path):
    site = tmp_path / "site"
    options = ["-q", "-W", "--keep-going", "-D", "run_tutorials=0", "-c", ROOT / "docs/site", "-d", tmp_path / "trees"]
    command = [sys.executable, "-m", "sphinx", "-b", "html", *options, ROOT, site]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr[-3000:]
    assert faults(site) == []
    assert (site / "searchindex.js").exists()
    start = (site / "README.html").read_text(encoding="utf-8")
    for word in ("sensation-level", "provenance", "thenar-eminence", "detection-threshold"):
        assert len(re.findall(rf'<a class="term[^"]*" href="docs/glossary.html#{word}"', start)) == 1
    assert "http-equiv" in (site / "index.html").read_text(encoding="ascii")
