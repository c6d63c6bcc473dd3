"""What holds for the repository as a whole: locks, links, decisions, commands of the pages, examples."""

import re
from pathlib import Path

import numpy as np
import pytest
import soundfile
import typer

from tactuator.cli.main import build_app
from tactuator.io.columns import read_columns
from tactuator.io.shipped import EXAMPLES, example_names
from tools.cli_reference import sorted_commands
from tools.examples import write_all

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


def test_locks__each__names_no_host_has_hashes_and_holds_what_is_wanted():
    reasons = (ROOT / "docs" / "dependencies.md").read_text(encoding="utf-8").lower()
    assert pins("run").items() <= pins("test").items() <= pins("site").items()
    for name in ("run", "test", "site"):
        packages = re.split(r"\n(?=\S)", lock(name))[1:]
        assert "://" not in lock(name)
        assert len(packages) > 20
        assert [package for package in packages if "--hash=sha256:" not in package] == []
        assert set(wanted(name)) - pins(name).keys() == set()
        assert [package for package in wanted(name) if f"- {package} (" not in reasons] == []


def test_texts_and_links__name_no_machine_and_lead_somewhere():
    words = ("/" + "work/", "/" + "root/", "pypi" + ".org", "pythonhosted" + ".org", "<" * 7 + " ")
    texts = {path: path.read_text(encoding="utf-8") for path in SOURCES if path.suffix not in BINARY}
    assert [str(path) for path, text in texts.items() if any(word in text for word in words)] == []
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


HAND_WRITTEN = {"README.md", "bench.toml", "display.toml", "protocol.toml"}


def is_generated(name: str) -> bool:
    return name not in HAND_WRITTEN and not (name.endswith(".toml") and "/" in name)


def same(one: Path, other: Path) -> bool:
    """Return whether two files hold the same: numbers but for the last digit, samples but for half a bit of sixteen."""
    if one.suffix in {".wav", ".flac"}:
        return bool(np.allclose(soundfile.read(one)[0], soundfile.read(other)[0], atol=2.0**-15))
    if one.name in {"bench.csv", "sheet.csv"}:
        columns = (read_columns(path).values for path in (one, other))
        mine, theirs = (np.array(list(values.values())) for values in columns)
        return bool(np.allclose(mine, theirs, atol=1e-3))
    return one.suffix == ".json" or one.read_bytes() == other.read_bytes()


@pytest.mark.slow
def test_examples__written_anew__are_those_that_are_shipped(tmp_path: Path) -> None:
    (tmp_path / "protocols").mkdir()
    write_all(tmp_path)
    written = {path.relative_to(tmp_path).as_posix() for path in tmp_path.rglob("*") if path.is_file()}
    assert written == {name for name in example_names() if is_generated(name)}
    assert [name for name in sorted(written) if not same(EXAMPLES / name, tmp_path / name)] == []
