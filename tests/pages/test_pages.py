"""Every command and Python block of the documents runs; and the site's pages are in two clicks, without a dead link."""

import re
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

from tactuator.experiment.protocol.file import StudyProtocol, parse_protocol
from tactuator.io.display import parse_display
from tools.pages.blocks import commands, read_page
from tools.pages.glossary import anchor, glossary
from tools.pages.navigation import LISTS, START, contents
from tools.pages.run import ENVIRONMENT, make_folder, run_page

ROOT = Path(__file__).resolve().parents[2]
README = ROOT / "README.md"
PAGES = [README, ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").glob("*.md")),
         *sorted((ROOT / "docs/tutorials").glob("*.md"))]  # fmt: skip
LANGUAGES = {"sh", "console", "python", "toml", "json", "csv", "text", "diff"}


TEXTS = {page: page.read_text(encoding="utf-8") for page in PAGES}


def cases():
    read = {page: read_page(TEXTS[page]) for page in PAGES}
    return [
        pytest.param(page, id=page.stem, marks=[pytest.mark.slow] if slow else [])
        for page, (blocks, _, slow) in read.items()
        if page != README and any(block.runs for block in blocks)  # which the next test runs
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


def test_readme__its_first_commands__print_at_most_40_lines_of_80_columns(tmp_path, monkeypatch):
    page = TEXTS[README]
    assert sum(block.runs for block in read_page(page)[0]) == 1
    first = page[page.index("<!-- serves -->") : page.index("| You have")]
    monkeypatch.setitem(ENVIRONMENT, "COLUMNS", "80")
    said = run_page(first, "README", tmp_path)
    assert [one.command.split()[1] for one in said if one.command.startswith("tactuator")] == [
        "init", "identify", "design", "console",
    ]  # fmt: skip
    lines = [line for one in said for line in one.output.splitlines()]
    assert len(lines) <= 40
    assert [line for line in lines if len(line) > 80] == []


def test_pages__every_block__says_its_language_and_runs_or_is_read():
    blocks = [(page.stem, block) for page in PAGES for block in read_page(TEXTS[page])[0]]
    assert [(page, block.line) for page, block in blocks if block.language not in LANGUAGES] == []
    plain = [block for page, block in blocks if page != "cli" and block.language not in ("sh", "console", "python")]
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


ALL_PAGES = {
    str(path.relative_to(ROOT).with_suffix(""))
    for path in [*ROOT.glob("*.md"), *(ROOT / "docs").rglob("*.md")]
    if not path.is_relative_to(ROOT / "docs" / "python")
}


def links_of(page: str) -> set[str]:
    text = (ROOT / f"{page}.md").read_text(encoding="utf-8")
    targets = re.findall(r"\]\(([^)#:\s]+)\.md(?:#[^)]*)?\)", text)
    return {str((ROOT / f"{page}.md").parent.joinpath(link).resolve().relative_to(ROOT)) for link in targets}


def test_pages__every_one__is_within_two_clicks_of_the_readme():
    links = {page: links_of(page) for page in ALL_PAGES}
    near = links[START].union({START}, *(links.get(page, set()) for page in links[START]))
    assert sorted(ALL_PAGES - near) == []
    texts = {name: (ROOT / f"{name}.md").read_text(encoding="utf-8") for name in LISTS}
    listed = [page for pages in contents(texts).values() for page in pages]
    assert len(listed) == len(set(listed))
    assert {START, *listed} == ALL_PAGES


def test_glossary__every_form__leads_to_a_heading_with_a_sentence():
    forms = glossary((ROOT / "docs/glossary.md").read_text(encoding="utf-8"))
    assert len(forms) > 100
    assert {"dB SL", "threshold curves", "prefilter"} <= set(forms)
    assert [form for form, (_, told) in forms.items() if len(told.split()) < 3] == []
    assert "load" not in forms  # it has other senses: found as "finger load" alone
    assert anchor("dB re 1 µm") == "db-re-1-µm"


@pytest.mark.slow
def test_site__as_make_builds_it__warns_of_nothing_and_loads_nothing_from_a_network(tmp_path):
    site = tmp_path / "site"
    options = ["-q", "-W", "--keep-going", "-D", "run_tutorials=0", "-c", ROOT / "docs/site", "-d", tmp_path / "trees"]
    command = [sys.executable, "-m", "sphinx", "-b", "html", *options, ROOT, site]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr[-3000:]
    loads = (
        r"""(?:src|srcset|data)="https?:|<link [^>]*stylesheet[^>]*"https?:|url\(["']?https?:|@import ["']?https?:"""
    )
    files = [path for path in site.rglob("*") if path.suffix in (".html", ".css")]
    assert len(files) > 30
    assert [path.name for path in files if re.search(loads, path.read_text(encoding="utf-8"))] == []
    reference = (site / "docs" / "python").glob("*.html")
    marks = [path.name for path in reference if re.search("Annotated|object at 0x", path.read_text(encoding="utf-8"))]
    assert marks == []
    start = (site / "README.html").read_text(encoding="utf-8")
    for word in ("sensation-level", "threshold-curve", "thenar-eminence", "prefilter"):
        assert len(re.findall(rf'<a class="term[^"]*" href="docs/glossary.html#{word}"', start)) == 1
