"""What holds for the repository as a whole: locks, words, links, decisions, what pages tell a reader to type."""

import importlib.metadata
import re
from pathlib import Path

import pytest
import typer
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

from tactuator.cli.main import build_app
from tools.cli_reference import sorted_commands

ROOT = Path(__file__).resolve().parents[2]
FOLDERS = ("src", "tests", "benchmarks", "witnesses", "tools", "core", "firmware", "docs", "requirements", ".ci")
SOURCES = [
    path
    for folder in FOLDERS
    for path in sorted((ROOT / folder).rglob("*"))
    if path.is_file() and "__pycache__" not in path.parts and ".egg-info" not in str(path)
] + [path for path in sorted(ROOT.iterdir()) if path.is_file() and path.name != ".git"]
TEXTS = [path for path in SOURCES if path.suffix not in {".so", ".o", ".wav", ".flac", ".h5", ".png", ".gz", ".npz"}]
PAGES = [path for path in SOURCES if path.suffix == ".md"]
COMMANDS = {path[1:]: command for path, command in sorted_commands(typer.main.get_command(build_app()), ("tactuator",))}
DECISIONS = ROOT / "docs" / "decisions"


def named(path: Path) -> str:
    return str(path.relative_to(ROOT))


def pins(lock: str) -> dict[str, str]:
    text = (ROOT / "requirements" / lock).read_text(encoding="ascii")
    return dict(re.findall(r"^(\S+)==(\S+) \\$", text, flags=re.MULTILINE))


def wanted(source: str) -> list[str]:
    lines = (ROOT / "requirements" / source).read_text(encoding="ascii").splitlines()
    return [line.strip().lower() for line in lines if line.strip() and not line.startswith(("#", "-"))]


@pytest.mark.parametrize("lock", ["run.txt", "test.txt", "site.txt"])
def test_lock__every_line__names_no_host_and_every_package_has_a_hash(lock):
    text = (ROOT / "requirements" / lock).read_text(encoding="ascii")
    packages = re.split(r"\n(?=\S)", text)[1:]
    assert "://" not in text
    assert len(packages) > 20
    assert [package for package in packages if "--hash=sha256:" not in package] == []


def test_locks__larger_set__holds_the_smaller_and_whatever_is_wanted():
    assert pins("run.txt").items() <= pins("test.txt").items() <= pins("site.txt").items()
    for name in ("run", "test", "site"):
        assert set(wanted(f"{name}.in")) - pins(f"{name}.txt").keys() == set()


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
    locked, lacking = pins("test.txt"), []
    for name in locked:
        for line in importlib.metadata.requires(name) or []:
            asked = Requirement(line)
            if asked.name.lower() != "pip" and (asked.marker is None or asked.marker.evaluate(where)):
                version = locked.get(canonicalize_name(asked.name), "")
                if not version or not asked.specifier.contains(version, prereleases=True):
                    lacking.append(f"{name}: {line}")
    assert lacking == []


@pytest.mark.parametrize(
    "word", ["/" + "work/", "/" + "root/", "pypi" + ".org", "pythonhosted" + ".org", "<" * 7 + " "]
)
def test_texts__every_one__names_no_machine_and_was_merged_to_the_end(word):
    assert [named(path) for path in TEXTS if word in path.read_text(encoding="utf-8")] == []


def test_links__in_the_documents__lead_somewhere():
    broken = []
    for page in PAGES:
        for target in re.findall(r"\]\(([^)#\s]+)[^)]*\)", page.read_text(encoding="utf-8")):
            if "://" not in target and not target.startswith("mailto:") and not (page.parent / target).exists():
                broken.append(f"{named(page)}: {target}")
    assert broken == []


def test_dependencies__each__has_its_reason():
    page = (ROOT / "docs" / "dependencies.md").read_text(encoding="utf-8").lower()
    names = [*wanted("run.in"), *wanted("test.in"), *wanted("site.in")]
    assert [name for name in names if f"- {name} (" not in page] == []


def test_decisions__every_one__stands_in_the_index_under_its_title_and_says_why():
    index = re.findall(r"^\| \[\d{4}\]\(([^)]+)\) \| (.+) \|$", (DECISIONS / "README.md").read_text("utf-8"), re.M)
    texts = {path.name: path.read_text(encoding="utf-8") for path in sorted(DECISIONS.glob("[0-9]*.md"))}
    titles = {name: text.partition("\n")[0].removeprefix(f"# {name[:4]}. ") for name, text in texts.items()}
    assert titles == dict(index)
    assert [name for name, text in texts.items() if "**Decided.**" not in text or "**Why" not in text] == []


def code_in(page: Path) -> str:
    """The code of a page: fenced blocks and spans, line ends that continue a command joined."""
    text = page.read_text(encoding="utf-8").replace("\\\n", " ")
    fenced = re.findall(r"^```[a-z]*\n(.*?)^```", text, flags=re.MULTILINE | re.DOTALL)
    spans = re.findall(r"`([^`\n]+)`", re.sub(r"^```.*?^```", "", text, flags=re.MULTILINE | re.DOTALL))
    return "\n".join([*fenced, *spans])


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_page__every_target_of_make_and_every_command__exists_with_its_options(page):
    targets = set(re.findall(r"^([a-z-]+):", (ROOT / "Makefile").read_text(encoding="utf-8"), flags=re.MULTILINE))
    assert set(re.findall(r"^\s*(?:\$ )?make ([a-z][a-z-]*)", code_in(page), flags=re.MULTILINE)) - targets == set()
    wrong = []
    for line in re.findall(
        r"^\s*(?:\$ )?(?:\.venv/bin/)?tactuator ([a-z][^|#>\n]*)", code_in(page), flags=re.MULTILINE
    ):
        words = line.split()
        command = COMMANDS.get(tuple(words[:1])) or COMMANDS.get(tuple(words[:2]))
        known = (
            {name for parameter in command.params for name in (*parameter.opts, *parameter.secondary_opts)}
            if command
            else {}
        )
        options = [word.split("=")[0] for word in words if re.match(r"--[a-z]", word)]
        wrong += [line] if command is None else [f"{line}: {word}" for word in options if word not in known]
    assert wrong == []
