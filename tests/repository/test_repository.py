"""What holds for the repository as a whole."""

import ast
import importlib.metadata
import re
from collections import Counter
from pathlib import Path

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

ROOT = Path(__file__).resolve().parents[2]
FOLDERS = ("src", "tests", "benchmarks", "witnesses", "tools", "core", "firmware", "docs", "requirements", ".ci")
SOURCES = [
    path
    for folder in FOLDERS
    for path in sorted((ROOT / folder).rglob("*"))
    if path.is_file() and "__pycache__" not in path.parts and ".egg-info" not in str(path)
] + [path for path in sorted(ROOT.iterdir()) if path.is_file() and path.name != ".git"]
TEXTS = [path for path in SOURCES if path.suffix not in {".so", ".o", ".wav", ".flac", ".h5", ".png", ".gz", ".npz"}]
CODE = [path for path in SOURCES if path.suffix in {".py", ".c", ".h"}]
LONGEST_FILE, LONGEST_FUNCTION, MOST_MODULES = 350, 50, 14


def named(path: Path) -> str:
    return str(path.relative_to(ROOT))


def test_locks__every_line__names_no_host_and_every_package_has_a_hash():
    for lock in ("run.txt", "test.txt", "site.txt"):
        text = (ROOT / "requirements" / lock).read_text(encoding="ascii")
        assert "://" not in text
        packages = re.split(r"\n(?=\S)", text)[1:]
        assert len(packages) > 20
        assert [package for package in packages if "--hash=sha256:" not in package] == []


def pins(lock: str) -> dict[str, str]:
    text = (ROOT / "requirements" / lock).read_text(encoding="ascii")
    return dict(re.findall(r"^(\S+)==(\S+) \\$", text, flags=re.MULTILINE))


def wanted(source: str) -> list[str]:
    lines = (ROOT / "requirements" / source).read_text(encoding="ascii").splitlines()
    return [line.strip().lower() for line in lines if line.strip() and not line.startswith(("#", "-"))]


def test_locks__larger_set__holds_the_smaller():
    assert pins("run.txt").items() <= pins("test.txt").items() <= pins("site.txt").items()


@pytest.mark.parametrize("name", ["run", "test", "site"])
def test_locks__whatever_is_wanted__is_pinned(name):
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


@pytest.mark.parametrize("word", ["/" + "work/", "/" + "root/", "pypi" + ".org", "pythonhosted" + ".org"])
def test_texts__every_one__names_no_machine(word):
    naming = [named(path) for path in TEXTS if word in path.read_text(encoding="utf-8")]
    assert naming == []


def test_texts__every_one__was_merged_to_the_end():
    marks = ("<" * 7 + " ", ">" * 7 + " ")
    half = [
        named(path) for path in TEXTS if any(line.startswith(marks) for line in path.read_text("utf-8").splitlines())
    ]
    assert half == []


def test_files__every_one__is_short():
    long = {named(path): lines for path in CODE if (lines := path.read_text("utf-8").count("\n")) > LONGEST_FILE}
    assert long == {}


def test_functions__every_one__fits_a_screen():
    long = {}
    for path in (path for path in CODE if path.suffix == ".py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
                lines = (node.end_lineno or 0) - node.lineno + 1
                if lines > LONGEST_FUNCTION:
                    long[f"{named(path)}:{node.name}"] = lines
    assert long == {}


def crowded(modules: list[Path]) -> dict[str, int]:
    """Return the folders that hold more modules than the limit, with their number."""
    count = Counter(named(path.parent) for path in modules if path.suffix in {".py", ".c"} and path.stem != "__init__")
    return {folder: number for folder, number in sorted(count.items()) if number > MOST_MODULES}


def test_folders__every_one__holds_fourteen_modules_at_most():
    assert crowded(CODE) == {}


def test_folder__with_one_module_too_many__is_found():
    modules = [ROOT / "core" / "room" / f"part_{number}.c" for number in range(MOST_MODULES + 1)]
    assert crowded([*modules, ROOT / "core" / "room" / "part_0.h"]) == {"core/room": MOST_MODULES + 1}
    assert crowded(modules[1:]) == {}


def test_modules__none__is_a_drawer_for_everything():
    drawers = {"utils", "util", "helpers", "helper", "common", "misc"}
    assert [named(path) for path in CODE if path.stem in drawers] == []


def test_links__in_the_documents__lead_somewhere():
    broken = []
    for page in [path for path in SOURCES if path.suffix == ".md"]:
        for target in re.findall(r"\]\(([^)#\s]+)[^)]*\)", page.read_text(encoding="utf-8")):
            if "://" not in target and not target.startswith("mailto:") and not (page.parent / target).exists():
                broken.append(f"{named(page)}: {target}")
    assert broken == []


def test_dependencies__each__has_its_reason():
    page = (ROOT / "docs" / "dependencies.md").read_text(encoding="utf-8").lower()
    names = [*wanted("run.in"), *wanted("test.in"), *wanted("site.in")]
    assert [name for name in names if f"| {name} |" not in page] == []
