"""Every command and every Python block of the documents runs, in a folder made by `tactuator init --examples`."""

import re
import shutil
import tomllib
from pathlib import Path

import pytest

from tactuator.experiment.protocol.file import parse_any_protocol
from tactuator.io.display import parse_display
from tools.pages.blocks import commands, read_page
from tools.pages.run import PageFault, make_folder, run_page

ROOT = Path(__file__).resolve().parents[2]
PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").glob("*.md")),
         *sorted((ROOT / "docs/tutorials").glob("*.md"))]  # fmt: skip
LANGUAGES = {"sh", "python", "toml", "json", "csv", "text", "diff"}


def page_text(page: Path) -> str:
    return page.read_text(encoding="utf-8")


def cases():
    read = {page: read_page(page_text(page)) for page in PAGES}
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
    run_page(page_text(page), str(page.relative_to(ROOT)), folder)


def test_pages__every_block__says_its_language_and_runs_its_commands_or_says_why_not():
    blocks = [(page.stem, block) for page in PAGES for block in read_page(page_text(page))[0]]
    assert [(page, block.line) for page, block in blocks if block.language not in LANGUAGES] == []
    plain = [block for page, block in blocks if page != "cli" and block.language not in ("sh", "python")]
    lines = [line for block in plain for line in commands(block.text)]
    assert [line for line in lines if re.match(r"(\$ )?(tactuator|make) [a-z]", line)] == []
    reasons = [block.marks["not run"] for _, block in blocks if "not run" in block.marks]
    assert [reason for reason in reasons if len(reason.split()) < 3] == []
    assert len(reasons) <= sum(block.runs for _, block in blocks) / 3


def parsed(text: str) -> str:
    """Parse a file that a page shows, by the program's own parser if it is whole, and say which kind it is."""
    document = tomllib.loads(text)
    if "channel" in document:
        parse_display(document)
        return "display"
    if "study" in document:
        parse_any_protocol(text)
        return "protocol"
    return "part"


def test_pages__every_file_they_show__is_one_that_the_program_takes():
    shown = [
        (page.stem, parsed(block.text))
        for page in PAGES
        for block in read_page(page_text(page))[0]
        if block.language == "toml"
    ]
    assert {("display", "display"), ("experiments", "protocol"), ("open-loop", "part")} <= set(shown)


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
