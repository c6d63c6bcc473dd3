"""The C core, compiled from core/ and bound with cffi (see _core_build.py)."""

from typing import Any

ffi: Any
lib: Any
