"""Parts of the build that pyproject.toml cannot say: the C core, bound with cffi; the sources that go into a wheel."""

import shutil
from pathlib import Path

from setuptools import setup
from setuptools.command.build_py import build_py

ROOT = Path(__file__).resolve().parent
CORE = "src/tactuator/runtime/_core_build.py"


class BuildWithSources(build_py):
    """The package with core/ and firmware/ in it, so that `tactuator firmware` works from a wheel."""

    def run(self) -> None:
        """Copy the sources beside the modules; an editable installation has them in the checkout."""
        super().run()
        if self.editable_mode:
            return
        for name in ("core", "firmware"):
            if (ROOT / name).is_dir():
                target = Path(self.build_lib) / "tactuator" / "sources" / name
                shutil.copytree(ROOT / name, target, ignore=shutil.ignore_patterns("*.o", "*.so"), dirs_exist_ok=True)


setup(
    cmdclass={"build_py": BuildWithSources},
    cffi_modules=[f"{CORE}:ffibuilder"] if (ROOT / CORE).exists() else [],
    options={
        # A changed header does not make setuptools compile again; a build that was asked for compiles.
        "build_ext": {"force": True},
        # The core's binding keeps to Python's stable interface: one wheel serves 3.11 and all later ones.
        "bdist_wheel": {"py_limited_api": "cp311"},
    },
)
