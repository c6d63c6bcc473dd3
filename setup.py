"""The one part of the build that pyproject.toml cannot say: the C core, bound with cffi."""

from pathlib import Path

from setuptools import setup

CORE = "src/tactuator/runtime/_core_build.py"

setup(
    cffi_modules=[f"{CORE}:ffibuilder"] if (Path(__file__).parent / CORE).exists() else [],
    # A changed header does not make setuptools compile again; a build that was asked for compiles.
    options={"build_ext": {"force": True}},
)
