"""Make `.venv` what the lock files and the sources say it is: `python3 tools/install.py run|test`.

Needs Python >= 3.11 with venv and pip, a C compiler, and nothing else. Nothing is done when nothing changed
(stamps in `.venv` hold the hashes of what it was made from); a file lock lets one run at a time do the work.
The syntax stays old on purpose: a Python too old must get as far as being told so.
"""

import sys

if sys.version_info < (3, 11):
    sys.exit(
        "tactuator needs Python 3.11 or later; %s is %d.%d: give another with `make PYTHON=python3.11 ...`"
        % ((sys.executable, *sys.version_info[:2]))
    )

import fcntl
import hashlib
import json
import os
import shlex
import shutil
import subprocess
import sysconfig
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
VENV = ROOT / ".venv"
PYTHON = VENV / "bin" / "python"
UV = VENV / "bin" / "uv"
PACKAGES_STAMP = VENV / "packages.stamp"
BUILD_STAMP = VENV / "build.stamp"
LOCKS = {"run": ROOT / "requirements" / "run.txt", "test": ROOT / "requirements" / "test.txt"}
BUILD_SOURCES = ("pyproject.toml", "setup.py", "src/tactuator/runtime/_core_build.py", "core")


def say(text):
    """Tell the person at the terminal what is being done."""
    print("install: " + text, file=sys.stderr, flush=True)


def run(command, env=None, quiet=False):
    """Run a command; its output is shown only when it fails, and then it raises CalledProcessError."""
    done = subprocess.run(
        [str(part) for part in command],
        cwd=ROOT,
        env=env,
        text=True,
        check=False,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
    )
    if done.returncode != 0:
        if not quiet:
            sys.stderr.write(done.stdout)
        raise subprocess.CalledProcessError(done.returncode, command, done.stdout)
    return done.stdout


# -- what is there, and what should be ---------------------------------------------------------------------------


def file_hash(path):
    """Return the SHA-256 of a file, in hex."""
    return hashlib.sha256(path.read_bytes()).hexdigest()


def sources_hash():
    """Hash of everything that the build reads."""
    digest = hashlib.sha256(sys.version.encode())
    for name in BUILD_SOURCES:
        path = ROOT / name
        for file in sorted(path.rglob("*")) if path.is_dir() else [path]:
            if file.is_file() and file.suffix != ".o":
                digest.update(str(file.relative_to(ROOT)).encode() + b"\0" + file.read_bytes())
    return digest.hexdigest()


def built_with():
    """What a `.venv` cannot survive: another interpreter, another place."""
    return {"python": sys.version, "prefix": os.path.realpath(sys.base_prefix), "root": str(ROOT)}


def read_stamp():
    """Return what `.venv` was made from; nothing when it is not (wholly) there."""
    try:
        return json.loads(PACKAGES_STAMP.read_text())
    except (OSError, ValueError):
        return {}


def packages_wanted(which, stamp):
    """Which set to install: None when the one asked for is there (the test set holds the runtime set)."""
    usable = all(stamp.get(key) == value for key, value in built_with().items()) and PYTHON.exists()
    if not usable:
        return which, "anew"
    have = stamp.get("locks", {})
    run_current = have.get("run") == file_hash(LOCKS["run"])
    test_current = have.get("test") == file_hash(LOCKS["test"])
    if run_current and (which == "run" or test_current):
        return None, ""
    if run_current and "test" not in have:
        return "test", "add"
    return ("test" if "test" in have else which), "sync"


# -- the packages ------------------------------------------------------------------------------------------------


def make_venv():
    """Make an empty virtual environment, or say in one sentence what is missing."""
    say("making .venv with Python %d.%d" % sys.version_info[:2])
    try:
        run([os.path.realpath(sys.executable), "-m", "venv", "--clear", VENV], quiet=True)
    except subprocess.CalledProcessError:
        sys.exit("Python's venv module cannot make .venv: install python3-venv (or a Python with venv and pip)")


def locked(name, lock):
    """The lines of one package in a lock file, hashes and all."""
    lines, inside = [], False
    for line in lock.read_text().splitlines():
        if not line.startswith(" "):
            inside = line.startswith(name + "==")
        if inside:
            lines.append(line)
    return "\n".join(lines) + "\n"


def uv_environment():
    """The environment for uv: it does not read pip's configuration, so that is handed over here."""
    settings = {}
    for line in run([PYTHON, "-m", "pip", "config", "list"], quiet=True).splitlines():
        key, _, value = line.partition("=")
        settings[key.rpartition(".")[2].strip()] = value.strip().strip("'\"")
    env = dict(os.environ, UV_NO_PROGRESS="1", UV_PYTHON_DOWNLOADS="never", VIRTUAL_ENV=str(VENV))
    env.pop("UV_PYTHON", None)
    known = {
        "UV_DEFAULT_INDEX": settings.get("index-url"),
        "UV_INDEX": settings.get("extra-index-url"),
        "UV_FIND_LINKS": ",".join(settings.get("find-links", "").split()),
        "UV_INSECURE_HOST": settings.get("trusted-host"),
        "UV_HTTP_TIMEOUT": settings.get("default-timeout") or settings.get("timeout"),
        "SSL_CERT_FILE": settings.get("cert"),
        # pip takes the best of all indexes; every file's hash is in the lock, so uv may as well.
        "UV_INDEX_STRATEGY": "unsafe-best-match",
    }
    for key, value in known.items():
        if value:
            env.setdefault(key, value)
    return env


def get_uv():
    """The locked uv into .venv; False where pip cannot bring it."""
    pinned = locked("uv", LOCKS["run"])
    wanted = VENV / "uv.txt"
    if UV.exists() and wanted.exists() and wanted.read_text() == pinned:
        return True
    part = VENV / "uv.txt.part"
    part.write_text(pinned)
    try:
        run([PYTHON, "-m", "pip", "install", "--quiet", "--require-hashes", "--no-deps", "-r", part], quiet=True)
    except subprocess.CalledProcessError:
        return False
    part.rename(wanted)
    return True


def install_packages(which, how):
    """Bring one set into `.venv`: "anew", "sync" (what the lock does not name goes) or "add" (nothing goes)."""
    lock = LOCKS[which]
    PACKAGES_STAMP.unlink(missing_ok=True)
    if how == "anew":
        make_venv()
    if how != "add":
        BUILD_STAMP.unlink(missing_ok=True)  # a sync takes the package itself away
    say("installing the %s set from requirements/%s" % ("test" if which == "test" else "runtime", lock.name))
    verb = ["install"] if how == "add" else ["sync"]
    try:
        if not get_uv():
            raise OSError("no uv")
        run(
            [UV, "pip", *verb, "--quiet", "--require-hashes", "-r" if how == "add" else lock]
            + ([lock] if how == "add" else []),
            env=uv_environment(),
            quiet=True,
        )
    except (OSError, subprocess.CalledProcessError):
        say("uv cannot reach its index here: pip does it, more slowly")
        try:
            run([PYTHON, "-m", "pip", "install", "--quiet", "--require-hashes", "-r", lock])
        except subprocess.CalledProcessError:
            sys.exit("the packages of requirements/%s could not be installed (pip's words are above)" % lock.name)
    held = {name: file_hash(path) for name, path in LOCKS.items() if which == "test" or name == "run"}
    write_stamp(PACKAGES_STAMP, json.dumps(dict(built_with(), locks=held)))


def write_stamp(path, text):
    """Write beside, then rename: a stamp is whole or absent."""
    part = path.with_suffix(".part")
    part.write_text(text)
    part.rename(path)


# -- the package itself and its C core ---------------------------------------------------------------------------


def check_compiler():
    """One sentence for a missing compiler or missing headers."""
    compiler = shlex.split(os.environ.get("CC") or sysconfig.get_config_var("CC") or "cc")[0]
    if shutil.which(compiler) is None:
        sys.exit("tactuator's core is C and no compiler %r is to be found: install gcc (or set CC)" % compiler)
    if not (Path(sysconfig.get_path("include")) / "Python.h").exists():
        if os.geteuid() == 0 and shutil.which("apt-get"):
            say("installing Python's C headers (python3-dev)")
            subprocess.run(
                ["apt-get", "install", "-y", "-qq", "python3-dev"],
                check=False,
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
            )
        if not (Path(sysconfig.get_path("include")) / "Python.h").exists():
            sys.exit("Python's C headers (Python.h) are missing: install python3-dev")


def build():
    """Build the package in place when anything that it is built from has changed."""
    wanted = sources_hash()
    if BUILD_STAMP.exists() and BUILD_STAMP.read_text() == wanted:
        return
    check_compiler()
    say("building the C core")
    BUILD_STAMP.unlink(missing_ok=True)
    offline = ["--no-build-isolation", "--no-deps", "--quiet"]
    try:
        if UV.exists():
            command = [UV, "pip", "install", *offline, "--offline", "--reinstall-package", "tactuator", "-e", ROOT]
            run(command, env=uv_environment())
        else:
            run([PYTHON, "-m", "pip", "install", *offline, "--no-index", "-e", ROOT])
        # A function that is declared and nowhere defined shows only now.
        run([PYTHON, "-c", "import tactuator.runtime._core"])
    except subprocess.CalledProcessError:
        sys.exit("the build failed (the compiler's words are above)")
    write_stamp(BUILD_STAMP, wanted)


def main():
    """Do what is needed, one run at a time."""
    which = sys.argv[1] if len(sys.argv) == 2 else ""
    if which not in LOCKS:
        sys.exit("usage: python3 tools/install.py run|test")
    folder = ROOT / ".setup"
    folder.mkdir(exist_ok=True)
    with open(folder / "lock", "w", encoding="ascii") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        wanted, how = packages_wanted(which, read_stamp())
        if wanted:
            install_packages(wanted, how)
        build()


if __name__ == "__main__":
    try:
        main()
    except KeyboardInterrupt:
        sys.exit("interrupted")
