"""What the documents tell a reader to type is there to be typed."""

import re
from pathlib import Path

import pytest
import typer

from tactuator.cli.main import build_app
from tools.cli_reference import sorted_commands

ROOT = Path(__file__).resolve().parents[2]
PAGES = [*sorted(ROOT.glob("*.md")), *sorted((ROOT / "docs").rglob("*.md"))]
COMMANDS = {path[1:]: command for path, command in sorted_commands(typer.main.get_command(build_app()), ("tactuator",))}


def code_in(page: Path) -> str:
    """The code of a page: fenced blocks and spans, line ends that continue a command joined."""
    text = page.read_text(encoding="utf-8").replace("\\\n", " ")
    fenced = re.findall(r"^```[a-z]*\n(.*?)^```", text, flags=re.MULTILINE | re.DOTALL)
    spans = re.findall(r"`([^`\n]+)`", re.sub(r"^```.*?^```", "", text, flags=re.MULTILINE | re.DOTALL))
    return "\n".join([*fenced, *spans])


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_page__every_make_target__exists(page):
    targets = set(re.findall(r"^([a-z-]+):", (ROOT / "Makefile").read_text(encoding="utf-8"), flags=re.MULTILINE))
    asked = set(re.findall(r"^\s*(?:\$ )?make ([a-z][a-z-]*)", code_in(page), flags=re.MULTILINE))
    assert asked - targets == set()


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_page__every_command__exists_with_its_options(page):
    wrong = []
    for line in re.findall(
        r"^\s*(?:\$ )?(?:\.venv/bin/)?tactuator ([a-z][^|#>\n]*)", code_in(page), flags=re.MULTILINE
    ):
        words = line.split()
        command = COMMANDS.get(tuple(words[:1])) or COMMANDS.get(tuple(words[:2]))
        if command is None:
            wrong.append(line)
            continue
        known = {name for parameter in command.params for name in (*parameter.opts, *parameter.secondary_opts)}
        wrong += [f"{line}: {word}" for word in words if re.match(r"--[a-z]", word) and word.split("=")[0] not in known]
    assert wrong == []
