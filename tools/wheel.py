"""Build sdist and wheel into out/dist: `make wheel`. The wheel is built from the sdist, and its tag is checked.

auditwheel (requirements/wheel.txt, hashes checked) reads from the binary which symbols of the C library it needs; a tag
that promises an older system than those is refused. Nothing is written under out/dist before.
"""

import platform
import re
import shutil
import subprocess
import sys
import tarfile
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
DIST = ROOT / "out" / "dist"
AUDITOR = ROOT / ".setup" / "wheel"
LOCK = ROOT / "requirements" / "wheel.txt"
TAG = "manylinux_2_17_" + platform.machine()
BUILD = (
    "import sys; from setuptools import build_meta as b; "
    "print(getattr(b, sys.argv[1])(sys.argv[2], {'--build-option': sys.argv[3:]}))"
)


def run(command, cwd=ROOT):
    """Return the standard output of a command, or stop with its last words."""
    done = subprocess.run([str(word) for word in command], cwd=cwd, capture_output=True, text=True, check=False)
    if done.returncode != 0:
        sys.exit("wheel: %s failed:\n%s" % (command[0], (done.stdout + done.stderr).strip()[-2000:]))
    return done.stdout


def built(kind, source, target, *options):
    """Build an sdist or a wheel of the tree `source` into `target`; return its path."""
    said = run([sys.executable, "-c", BUILD, "build_" + kind, target, *options], cwd=source)
    return target / said.splitlines()[-1]


def auditor():
    """Return the path of auditwheel in an environment of its own, which is made if it is not that of the lock."""
    program, stamp = AUDITOR / "bin" / "auditwheel", AUDITOR / "lock.txt"
    if not (program.exists() and stamp.exists() and stamp.read_text() == LOCK.read_text()):
        shutil.rmtree(AUDITOR, ignore_errors=True)
        run([sys.executable, "-m", "venv", "--without-pip", AUDITOR])
        pip = [sys.executable, "-m", "pip", "--python", AUDITOR, "install", "--quiet", "--disable-pip-version-check"]
        run([*pip, "--require-hashes", "--only-binary=:all:", "-r", LOCK])
        stamp.write_text(LOCK.read_text())
    return program


def policy(wheel):
    """Return the strictest platform that auditwheel says the wheel's binaries keep to."""
    said = " ".join(run([auditor(), "show", wheel]).split())
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


def main():
    """Build both and check the wheel's tag; move them to out/dist when they are whole."""
    with tempfile.TemporaryDirectory(prefix="tactuator-wheel-") as folder:
        place = Path(folder)
        sdist = built("sdist", ROOT, place)
        with tarfile.open(sdist) as archive:
            archive.extractall(place / "source", filter="data")
        (source,) = (place / "source").iterdir()
        wheel = built("wheel", source, place, "--plat-name=" + TAG)
        if "-cp311-abi3-" + TAG not in wheel.name:
            sys.exit("wheel: its name is %s; expected cp311-abi3 and %s" % (wheel.name, TAG))
        require_tag(wheel, TAG)
        DIST.mkdir(parents=True, exist_ok=True)
        for path in (sdist, wheel):
            shutil.copyfile(path, DIST / (path.name + ".part"))
            (DIST / (path.name + ".part")).rename(DIST / path.name)
            print(DIST / path.name)


if __name__ == "__main__":
    main()
