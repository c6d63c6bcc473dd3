"""Opening of a store in which a study is about to begin; one that was made for nothing is taken away again."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from sqlalchemy import Table, exists, select

from tactuator.errors import BadInput
from tactuator.experiment.store import schema
from tactuator.experiment.store.store import Store


@contextmanager
def opened_store(path: Path) -> Iterator[Store]:
    """Yield the database at the path, open for the length of the context; it is made if it is not there.

    A database that was made here is taken away at the end if it holds no study, or if what was asked for was refused
    (BadInput) before anything was presented. Raises BadInput as `Store` does.
    """
    was_there = path.exists()
    store = Store(path)
    for_nothing = not was_there
    try:
        yield store
        for_nothing = for_nothing and not _holds(store, schema.study)
    except BadInput:
        for_nothing = for_nothing and not _holds(store, schema.run)
        raise
    except BaseException:
        for_nothing = for_nothing and not _holds(store, schema.study)
        raise
    finally:
        store.close()
        if for_nothing:
            for end in ("", "-wal", "-shm"):
                Path(f"{path}{end}").unlink(missing_ok=True)


def _holds(store: Store, table: Table) -> bool:
    with store.read() as connection:
        return bool(connection.execute(select(exists(select(table.c.id)))).scalar_one())
