"""Parts of the build that pyproject.toml cannot say: the C core, bound with cffi."""

from pathlib import Path

from setuptools import setup

ROOT = Path(__file__).resolve().parent
CORE = "src/tactuator/runtime/_core_build.py"

setup(
    cffi_modules=[f"{CORE}:ffibuilder"] if (ROOT / CORE).exists() else [],
    options={
        # A changed header does not make setuptools compile again; a build that was asked for compiles.
        "build_ext": {"force": True},
        # The core's binding keeps to Python's stable interface: one wheel serves 3.11 and all later ones.
        "bdist_wheel": {"py_limited_api": "cp311"},
    },
)
