"""What holds for the repository as a whole: locks, words, links, decisions, what pages tell a reader to type."""

import importlib.metadata
import re
from functools import cache
from pathlib import Path

import pytest
import typer
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

from tactuator.cli.main import build_app
from tools.cli_reference import sorted_commands

ROOT = Path(__file__).resolve().parents[2]
FOLDERS = ("src", "tests", "benchmarks", "witnesses", "tools", "core", "firmware", "docs", "requirements", ".ci")
BINARY = {".so", ".o", ".wav", ".flac", ".h5", ".png", ".gz", ".npz"}
SOURCES = [
    path
    for folder in FOLDERS
    for path in sorted((ROOT / folder).rglob("*"))
    if path.is_file() and "__pycache__" not in path.parts and ".egg-info" not in str(path)
] + [path for path in sorted(ROOT.iterdir()) if path.is_file() and path.name != ".git"]
PAGES = {path.relative_to(ROOT): path.read_text(encoding="utf-8") for path in SOURCES if path.suffix == ".md"}
COMMANDS = {path[1:]: command for path, command in sorted_commands(typer.main.get_command(build_app()), ("tactuator",))}
DECISIONS = ROOT / "docs" / "decisions"


def lock(name: str) -> str:
    return (ROOT / "requirements" / f"{name}.txt").read_text(encoding="ascii")


def pins(name: str) -> dict[str, str]:
    return dict(re.findall(r"^(\S+)==(\S+) \\$", lock(name), flags=re.MULTILINE))


def wanted(name: str) -> list[str]:
    lines = (ROOT / "requirements" / f"{name}.in").read_text(encoding="ascii").splitlines()
    return [line.strip().lower() for line in lines if line.strip() and not line.startswith(("#", "-"))]


def test_locks__each__names_no_host_has_hashes_and_holds_the_smaller_and_what_is_wanted_for_a_reason():
    reasons = (ROOT / "docs" / "dependencies.md").read_text(encoding="utf-8").lower()
    assert pins("run").items() <= pins("test").items() <= pins("site").items()
    for name in ("run", "test", "site"):
        packages = re.split(r"\n(?=\S)", lock(name))[1:]
        assert "://" not in lock(name)
        assert len(packages) > 20
        assert [package for package in packages if "--hash=sha256:" not in package] == []
        assert set(wanted(name)) - pins(name).keys() == set()
        assert [package for package in wanted(name) if f"- {package} (" not in reasons] == []


@cache
def requirements_of(*names: str) -> dict[str, list[Requirement]]:
    return {name: [Requirement(line) for line in importlib.metadata.requires(name) or []] for name in names}


@pytest.mark.parametrize("python", ["3.11", "3.12", "3.13", "3.14"])
@pytest.mark.parametrize(
    "system", [("linux", "Linux", "x86_64"), ("linux", "Linux", "aarch64"), ("darwin", "Darwin", "arm64")]
)
def test_locks__every_python_and_system__lack_nothing_that_a_package_asks_for(python, system):
    sys_platform, platform_system, machine = system
    where = {
        "python_version": python, "python_full_version": f"{python}.1", "sys_platform": sys_platform, "extra": "",
        "platform_system": platform_system, "platform_machine": machine, "os_name": "posix",
    }  # fmt: skip
    locked, lacking = pins("test"), []
    for name, requirements in requirements_of(*locked).items():
        for asked in requirements:
            if asked.name.lower() != "pip" and (asked.marker is None or asked.marker.evaluate(where)):
                version = locked.get(canonicalize_name(asked.name), "")
                if not version or not asked.specifier.contains(version, prereleases=True):
                    lacking.append(f"{name}: {asked}")
    assert lacking == []


def test_texts__every_one__names_no_machine_and_was_merged_to_the_end():
    words = ("/" + "work/", "/" + "root/", "pypi" + ".org", "pythonhosted" + ".org", "<" * 7 + " ")
    texts = {path: path.read_text(encoding="utf-8") for path in SOURCES if path.suffix not in BINARY}
    assert [str(path) for path, text in texts.items() if any(word in text for word in words)] == []


def test_links__in_the_documents__lead_somewhere():
    broken = []
    for page, text in PAGES.items():
        for target in re.findall(r"\]\(([^)#\s]+)[^)]*\)", text):
            if "://" not in target and not target.startswith("mailto:") and not (ROOT / page.parent / target).exists():
                broken.append(f"{page}: {target}")
    assert broken == []


def test_decisions__every_one__stands_in_the_index_under_its_title_and_says_why():
    index = re.findall(r"^\| \[\d{4}\]\(([^)]+)\) \| (.+) \|$", (DECISIONS / "README.md").read_text("utf-8"), re.M)
    texts = {path.name: path.read_text(encoding="utf-8") for path in sorted(DECISIONS.glob("[0-9]*.md"))}
    titles = {name: text.partition("\n")[0].removeprefix(f"# {name[:4]}. ") for name, text in texts.items()}
    assert titles == dict(index)
    assert [name for name, text in texts.items() if "**Decided.**" not in text or "**Why" not in text] == []


def code_in(text: str) -> str:
    """The code of a page: fenced blocks and spans, line ends that continue a command joined."""
    text = text.replace("\\\n", " ")
    fenced = re.findall(r"^```[a-z]*\n(.*?)^```", text, flags=re.MULTILINE | re.DOTALL)
    spans = re.findall(r"`([^`\n]+)`", re.sub(r"^```.*?^```", "", text, flags=re.MULTILINE | re.DOTALL))
    return "\n".join([*fenced, *spans])


def test_pages__every_target_of_make_and_every_command__exists_with_its_options():
    targets = set(re.findall(r"^([a-z-]+):", (ROOT / "Makefile").read_text(encoding="utf-8"), flags=re.MULTILINE))
    program, wrong = r"^\s*(?:\$ )?(?:\.venv/bin/)?tactuator ([a-z][^|#>\n]*)", []
    for page, code in ((page, code_in(text)) for page, text in PAGES.items()):
        wrong += [
            (page, name) for name in re.findall(r"^\s*(?:\$ )?make ([a-z][a-z-]*)", code, re.M) if name not in targets
        ]
        for words in map(str.split, re.findall(program, code, flags=re.MULTILINE)):
            command = COMMANDS.get(tuple(words[:1])) or COMMANDS.get(tuple(words[:2]))
            known = {name for each in command.params for name in (*each.opts, *each.secondary_opts)} if command else {}
            options = [word.split("=")[0] for word in words if re.match(r"--[a-z]", word)]
            wrong += [(page, *words)] if command is None else [(page, name) for name in options if name not in known]
    assert wrong == []
