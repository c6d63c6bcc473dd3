"""What takes seconds and is asked for again with the same arguments is computed once for all workers of a run."""

import hashlib
import os
import pickle
from collections.abc import Callable
from functools import wraps
from pathlib import Path
from typing import Any


def made_once(folder: Path, compute: Callable[..., Any]) -> Callable[..., Any]:
    """Return `compute`, whose results are kept in `folder` with all that it said to the functions it was given."""

    @wraps(compute)
    def kept(*asked: Any, **more: Any) -> Any:
        listeners = {name: value for name, value in more.items() if callable(value)}
        wishes = {name: value for name, value in more.items() if name not in listeners}
        file = folder / hashlib.sha256(pickle.dumps((compute.__qualname__, asked, wishes))).hexdigest()
        if file.exists():
            result, said = pickle.loads(file.read_bytes())
            for name, text in said:
                listeners[name](text)
            return result
        said = []
        heard = {name: lambda text, name=name: (said.append((name, text)), listeners[name](text)) for name in listeners}
        result = compute(*asked, **wishes, **heard)
        beside = file.with_name(f"{file.name}-{os.getpid()}")
        beside.write_bytes(pickle.dumps((result, said)))
        beside.replace(file)
        return result

    return kept
