"""Wheels of a few lines, and a build backend that makes one: the smallest packages that pip takes for real.

The backend is copied into the trees of test_install.py, so this file stands by itself.
"""

import hashlib
import zipfile
from pathlib import Path


def wheel(folder: Path, name: str, version: str, files: dict[str, str]) -> Path:
    """Write a wheel with these files and return its path."""
    path, about = folder / f"{name}-{version}-py3-none-any.whl", f"{name}-{version}.dist-info"
    files = files | {
        f"{about}/METADATA": f"Metadata-Version: 2.1\nName: {name}\nVersion: {version}\n",
        f"{about}/WHEEL": "Wheel-Version: 1.0\nGenerator: tests\nRoot-Is-Purelib: true\nTag: py3-none-any\n",
    }
    record = "".join(f"{file},,\n" for file in [*files, f"{about}/RECORD"])
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for file, text in [*files.items(), (f"{about}/RECORD", record)]:
            archive.writestr(file, text)
    return path


def lock_line(path: Path) -> str:
    """The requirement that pins a wheel by its hash."""
    name, version = path.name.split("-")[:2]
    return f"{name}=={version} \\\n    --hash=sha256:{hashlib.sha256(path.read_bytes()).hexdigest()}\n"


def get_requires_for_build_editable(settings: object = None) -> list[str]:
    return []


def build_editable(folder: str, settings: object = None, metadata: object = None) -> str:
    """The tree's own package: a path to its src."""
    source = Path(__file__).resolve().parent / "src"
    return wheel(Path(folder), "tactuator", "0", {"tactuator.pth": f"{source}\n"}).name
