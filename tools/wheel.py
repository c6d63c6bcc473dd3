"""Build sdist and wheel into out/dist: `make wheel`. The wheel is built from the sdist, and its tag is checked.

Beside them lies a list of the runtime packages with version and licence (CycloneDX, in JSON), made by cyclonedx-bom.
auditwheel (both of requirements/wheel.txt, hashes checked) reads from the binary which symbols of the C library it
needs; a tag that promises an older system than those is refused. Nothing is written under out/dist before.
"""

import gzip
import io
import os
import platform
import re
import shutil
import subprocess
import sys
import tarfile
import tempfile
from importlib.metadata import distribution
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
DIST = ROOT / "out" / "dist"
TOOLS = ROOT / ".setup" / "wheel"
LOCK, RUNTIME = (ROOT / "requirements" / name for name in ("wheel.txt", "run.txt"))
TAG = "manylinux_2_17_" + platform.machine()
BUILD = (
    "import sys; from setuptools import build_meta as b; "
    "print(getattr(b, sys.argv[1])(sys.argv[2], {'--build-option': sys.argv[3:]}))"
)


def run(command, cwd=ROOT, **environment):
    """Return the standard output of a command, or stop with its last words."""
    words, given = [str(word) for word in command], {**os.environ, **environment}
    done = subprocess.run(words, cwd=cwd, env=given, capture_output=True, text=True, check=False)
    if done.returncode != 0:
        sys.exit("wheel: %s failed:\n%s" % (command[0], (done.stdout + done.stderr).strip()[-2000:]))
    return done.stdout


def built(kind, source, target, *options):
    """Build an sdist or a wheel of the tree `source` into `target`; return its path."""
    flags = "%s -g0 -ffile-prefix-map=%s=." % (os.environ.get("CFLAGS", ""), source)  # no path of this machine
    environment = {"SOURCE_DATE_EPOCH": str(epoch()), "CFLAGS": flags, "PYTHONHASHSEED": "0"}
    said = run([sys.executable, "-c", BUILD, "build_" + kind, target, *options], cwd=source, **environment)
    return target / said.splitlines()[-1]


def epoch():
    """Return SOURCE_DATE_EPOCH, or the time of the newest commit: the same tree gives the same bytes."""
    return int(os.environ.get("SOURCE_DATE_EPOCH") or run(["git", "log", "-1", "--format=%ct"]))


def settle(sdist):
    """Write an sdist anew with the times and owners of no machine, its members in order."""
    with tarfile.open(sdist) as archive:
        members = sorted(archive.getmembers(), key=lambda member: member.name)
        contents = [archive.extractfile(member).read() if member.isfile() else None for member in members]
    with gzip.GzipFile(sdist, "wb", mtime=epoch()) as file, tarfile.open(fileobj=file, mode="w") as archive:
        for member, content in zip(members, contents, strict=True):
            member.mtime, member.uid, member.gid, member.uname, member.gname = epoch(), 0, 0, "", ""
            member.mode, member.pax_headers = 0o755 if member.isdir() or member.mode & 0o100 else 0o644, {}
            archive.addfile(member, None if content is None else io.BytesIO(content))


def tool(name):
    """Return the path of a program in an environment of its own, which is made if it is not that of the lock."""
    program, stamp = TOOLS / "bin" / name, TOOLS / "lock.txt"
    if not (program.exists() and stamp.exists() and stamp.read_text() == LOCK.read_text()):
        shutil.rmtree(TOOLS, ignore_errors=True)
        run([sys.executable, "-m", "venv", "--without-pip", TOOLS])
        pip = [sys.executable, "-m", "pip", "--python", TOOLS, "install", "--quiet", "--disable-pip-version-check"]
        run([*pip, "--require-hashes", "--only-binary=:all:", "-r", LOCK])
        stamp.write_text(LOCK.read_text())
    return program


def policy(wheel):
    """Return the strictest platform that auditwheel says the wheel's binaries keep to."""
    said = " ".join(run([tool("auditwheel"), "show", wheel]).split())
    found = re.search(r'consistent with the following platform tag: "(\w+)"', said)
    if found is None:
        sys.exit("wheel: auditwheel names no platform: %s" % said[:500])
    return found[1]


def require_tag(wheel, allowed):
    """Refuse a wheel whose binaries need a newer system than `allowed`, a manylinux tag, promises."""
    found = policy(wheel)
    needs = [int(number) for number in re.findall(r"\d+", found)[:2]]
    promised = [int(number) for number in re.findall(r"\d+", allowed)[:2]]
    if "manylinux" not in found or needs > promised:
        sys.exit("wheel: its binaries keep to %s, and its name says %s" % (found, allowed))


def runtime_environment(folder):
    """Make an environment that knows the packages of the runtime lock, by links to what is installed, and no other."""
    run([sys.executable, "-m", "venv", "--without-pip", folder])
    (packages,) = folder.glob("lib/python3*/site-packages")
    lock = RUNTIME.read_text(encoding="ascii")
    for name in re.findall(r"^([\w.-]+)==", lock, flags=re.MULTILINE):
        if name != "setuptools":  # it builds, and does not run
            metadata = Path(str(distribution(name).locate_file(metadata_folder(name))))
            (packages / metadata.name).symlink_to(metadata)
    return folder


def metadata_folder(name):
    """Return the name of the folder with a package's metadata."""
    return next(file.parts[0] for file in distribution(name).files if file.parts[0].endswith(".dist-info"))


def packages_list(wheel, place):
    """Write the list of the runtime packages; it tells neither time nor serial number, so it is the same each time."""
    path = place / (wheel.name.split("-cp")[0] + ".cdx.json")
    options = ["--output-reproducible", "--output-format", "JSON", "--output-file", path]
    about = ["--pyproject", ROOT / "pyproject.toml", runtime_environment(place / "run")]
    run([tool("cyclonedx-py"), "environment", *options, *about])
    return path


def main():
    """Build both and check the wheel's tag; move them to out/dist when they are whole, with the list of packages."""
    with tempfile.TemporaryDirectory(prefix="tactuator-wheel-") as folder:
        place = Path(folder)
        sdist = built("sdist", ROOT, place)
        settle(sdist)
        with tarfile.open(sdist) as archive:
            archive.extractall(place / "source", filter="data")
        (source,) = (place / "source").iterdir()
        wheel = built("wheel", source, place, "--plat-name=" + TAG)
        if "-cp311-abi3-" + TAG not in wheel.name:
            sys.exit("wheel: its name is %s; expected cp311-abi3 and %s" % (wheel.name, TAG))
        require_tag(wheel, TAG)
        DIST.mkdir(parents=True, exist_ok=True)
        for path in (sdist, wheel, packages_list(wheel, place)):
            shutil.copyfile(path, DIST / (path.name + ".part"))
            (DIST / (path.name + ".part")).rename(DIST / path.name)
            print(DIST / path.name)


if __name__ == "__main__":
    main()
