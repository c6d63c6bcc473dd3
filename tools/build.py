"""The package itself, in place, with its C core."""

import sys

from tools import stamps
from tools.needs import say
from tools.packages import explained, output_of


def is_due():
    """Return whether anything changed that the package is built from."""
    return not (stamps.BUILD_STAMP.exists() and stamps.BUILD_STAMP.read_text() == stamps.sources_hash())


def build():
    """Build the package and import its core; in one line why that cannot be, under the compiler's words."""
    say("building the C core")
    wanted = stamps.sources_hash()
    stamps.BUILD_STAMP.unlink(missing_ok=True)
    pip = [stamps.PYTHON, "-m", "pip", "install", "--quiet", "--no-input", "--disable-pip-version-check"]
    steps = [[*pip, "--no-build-isolation", "--no-deps", "--no-index", "-e", stamps.ROOT]]
    # A function that is declared and nowhere defined shows only when the core is loaded.
    steps += [[stamps.PYTHON, "-c", "import " + core] for core in core_modules()]
    # The first command should not have to compile three hundred modules.
    steps += [[stamps.PYTHON, "-m", "compileall", "-q", stamps.ROOT / "src"]]
    for step in steps:
        done = output_of(step)
        if done.returncode != 0:
            sys.stderr.write(done.stdout)
            sys.exit(explained(done.stdout, "the build failed"))
    stamps.write(stamps.BUILD_STAMP, wanted)


def core_modules():
    """Return the names of the modules that the build makes: `_core_build.py` makes `_core` beside itself."""
    source = stamps.ROOT / "src"
    scripts = sorted(source.rglob("_core_build.py"))
    return [".".join([*script.parent.relative_to(source).parts, "_core"]) for script in scripts]
