"""Every command and Python block of the documents runs; and the site's pages are in two clicks, without a dead link."""

import re
import shutil
import subprocess
import sys
import tomllib
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlsplit

import pytest

from tactuator.experiment.protocol.file import StudyProtocol, parse_protocol
from tactuator.io.display import parse_display
from tools.pages.blocks import Block, commands, read_page
from tools.pages.executed import with_outputs
from tools.pages.glossary import anchor, glossary, pattern
from tools.pages.navigation import LISTS, START, contents, entries
from tools.pages.run import PageFault, Said, make_folder, run_page

ROOT = Path(__file__).resolve().parents[2]
PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").glob("*.md")),
         *sorted((ROOT / "docs/tutorials").glob("*.md"))]  # fmt: skip
LANGUAGES = {"sh", "python", "toml", "json", "csv", "text", "diff"}


TEXTS = {page: page.read_text(encoding="utf-8") for page in PAGES}


def cases():
    read = {page: read_page(TEXTS[page]) for page in PAGES}
    return [
        pytest.param(page, id=page.stem, marks=[pytest.mark.slow] if slow else [])
        for page, (blocks, _, slow) in read.items()
        if any(block.runs for block in blocks)
    ]


@pytest.fixture(scope="session")
def examples(tmp_path_factory):
    folder = tmp_path_factory.mktemp("pages") / "examples"
    make_folder(folder)
    return folder


@pytest.mark.parametrize("page", cases())
@pytest.mark.filterwarnings("default")  # what a page starts may warn in other libraries; a reader sees it as well
def test_page__typed_in_order__does_what_it_says(page, examples, tmp_path):
    folder = shutil.copytree(examples, tmp_path / "folder")
    run_page(TEXTS[page], str(page.relative_to(ROOT)), folder)


def test_pages__every_block_and_file__says_its_language_runs_or_is_taken_by_the_program():
    blocks = [(page.stem, block) for page in PAGES for block in read_page(TEXTS[page])[0]]
    assert [(page, block.line) for page, block in blocks if block.language not in LANGUAGES] == []
    plain = [block for page, block in blocks if page != "cli" and block.language not in ("sh", "python")]
    lines = [line for block in plain for line in commands(block.text)]
    assert [line for line in lines if re.match(r"(\$ )?(tactuator|make) [a-z]", line)] == []
    reasons = [block.marks["not run"] for _, block in blocks if "not run" in block.marks]
    assert [reason for reason in reasons if len(reason.split()) < 3] == []
    assert len(reasons) <= sum(block.runs for _, block in blocks) / 3
    shown = [
        (page.stem, parsed(block.text))
        for page in PAGES
        for block in read_page(TEXTS[page])[0]
        if block.language == "toml"
    ]
    assert {("display", "display"), ("experiments", "protocol"), ("open-loop", "part")} <= set(shown)


def parsed(text: str) -> str:
    """Parse a file that a page shows, by the program's own parser if it is whole, and say which kind it is."""
    document = tomllib.loads(text)
    if "channel" in document:
        parse_display(document)
        return "display"
    if "study" in document:
        parse_protocol(text, StudyProtocol)
        return "protocol"
    return "part"


@pytest.mark.parametrize(
    ("page", "words"),
    [
        ("```sh\ntactuator design no-such.toml --out c.json\n```\n", "ended with status 2, not 0"),
        ("<!-- exit 1 -->\n```sh\ntrue\n```\n", "ended with status 0, not 1"),
        ("```sh\ngrep --quiet absent display.toml | false\n```\n", "ended with status 1, not 0"),
        ("```python\nvalue = 1\n```\n\n```python\nraise KeyError(value)\n```\n", "line 6"),
        ("<!-- figure: missing.svg | A picture -->\n", "no file missing.svg to show"),
        ("<!-- serves -->\n```sh\ntactuator --version\n```\n", "ended with status"),
    ],
)
def test_run_page__with_one_fault__is_caught(page, words, examples, tmp_path):
    folder = shutil.copytree(examples, tmp_path / "folder")
    with pytest.raises(PageFault) as fault:
        run_page(page, "page.md", folder)
    assert words in str(fault.value)


def test_run_page__file_and_later_blocks__stand_in_one_folder(examples, tmp_path):
    folder = shutil.copytree(examples, tmp_path / "folder")
    page = (
        "<!-- file: a.csv -->\n```csv\nx,y\n1,2\n```\n\n```sh\ncp a.csv b.csv\ncat b.csv # shown\n```\n\n"
        "```python\nimport pathlib\nprint(pathlib.Path('b.csv').read_text())\n```\n"
    )
    said = run_page(page, "page.md", folder)
    assert [each.output.strip() for each in said] == ["", "x,y\n1,2", "x,y\n1,2"]
    assert [each.end for each in said] == [10, 10, 15]


ALL_PAGES = {
    str(path.relative_to(ROOT).with_suffix(""))
    for path in [*ROOT.glob("*.md"), *(ROOT / "docs").rglob("*.md")]
    if not path.is_relative_to(ROOT / "docs" / "python")
}


def links_of(page: str) -> set[str]:
    text = (ROOT / f"{page}.md").read_text(encoding="utf-8")
    targets = re.findall(r"\]\(([^)#:\s]+)\.md(?:#[^)]*)?\)", text)
    return {str((ROOT / f"{page}.md").parent.joinpath(link).resolve().relative_to(ROOT)) for link in targets}


def within_two_clicks(links: dict[str, set[str]]) -> set[str]:
    first = links[START]
    return {START} | first | set().union(*(links.get(page, set()) for page in first))


def test_pages__every_one__is_within_two_clicks_of_the_readme_and_once_in_the_navigation():
    links = {page: links_of(page) for page in ALL_PAGES}
    assert sorted(ALL_PAGES - within_two_clicks(links)) == []
    chain = {START: {"a"}, "a": {"b"}, "b": {"c"}, "c": set()}
    assert set(chain) - within_two_clicks(chain) == {"c"}
    texts = {name: (ROOT / f"{name}.md").read_text(encoding="utf-8") for name in LISTS}
    listed = [page for pages in contents(texts).values() for page in pages]
    assert len(listed) == len(set(listed))
    assert {START, *listed} == ALL_PAGES


def test_entries_and_pattern__bullets_rows_and_the_longest_form__are_taken():
    text = "- [a](a.md): words\n| [b](../b.md#part) | x |\n| [c](../c.md) | x |\nsee [d](d.md)\n- [e](https://x/e.md)\n"
    assert entries("docs/list", text) == ["docs/a", "c"]
    find = pattern(["threshold", "detection threshold", "C"])
    assert [match[0] for match in find.finditer("Detection\nthreshold, thresholds, sub-threshold, C-like")] == [
        "Detection\nthreshold"
    ]


def test_glossary__every_form__leads_to_a_heading_with_a_sentence():
    forms = glossary((ROOT / "docs/glossary.md").read_text(encoding="utf-8"))
    assert len(forms) > 100
    assert {"dB SL", "threshold curves", "prefilter"} <= set(forms)
    assert [form for form, (_, told) in forms.items() if len(told.split()) < 3] == []
    assert "load" not in forms  # it has other senses: found as "finger load" alone
    assert anchor("dB re 1 µm") == "db-re-1-µm"


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
