"""What takes seconds and is asked for again and again, with the same arguments, is computed once in a run of the tests.

The key is what is asked, whole; the files belong to one run and are shared by its workers.
"""

import hashlib
import pickle
from collections.abc import Callable
from functools import wraps
from pathlib import Path
from typing import Any

from tactuator.io.atomic import atomic_path


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

        def heard(name: str) -> Callable[[str], None]:
            return lambda text: (said.append((name, text)), listeners[name](text))[1]

        result = compute(*asked, **wishes, **{name: heard(name) for name in listeners})
        with atomic_path(file) as beside:
            beside.write_bytes(pickle.dumps((result, said)))
        return result

    return kept
