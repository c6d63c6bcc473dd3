"""How a database came to have the tables it has: one step for each version, each in a transaction of its own."""

from __future__ import annotations

from collections.abc import Callable

from sqlalchemy import Connection, Engine, Table, inspect, select

from tactuator.errors import BadInput
from tactuator.experiment.store import schema


def _create(*made: Table) -> Callable[[Connection], None]:
    def step(connection: Connection) -> None:
        schema.tables.create_all(connection, tables=list(made))

    return step


STEPS: tuple[Callable[[Connection], None], ...] = (
    # 1: thresholds.
    _create(
        schema.schema_version,
        schema.study,
        schema.session,
        schema.run,
        schema.trial,
        schema.interval,
        schema.response,
        schema.event,
    ),
    # 2: identification experiments have stimuli and responses of their own.
    _create(schema.stimulus, schema.response_option),
)


def migrate(engine: Engine, upto: int = len(STEPS)) -> int:
    """Bring the database to version `upto`; the version it had.

    Raises BadInput for a database of a later tool, or one that holds other tables and no version.
    """
    had = version(engine)
    if had > len(STEPS):
        raise BadInput(f"store has schema version {had}; allowed: up to {len(STEPS)} (a later tactuator wrote it)")
    for number in range(had, upto):
        with engine.begin() as connection:
            STEPS[number](connection)
            connection.execute(schema.schema_version.delete())
            connection.execute(schema.schema_version.insert().values(version=number + 1))
    return had


def version(engine: Engine) -> int:
    """Schema version, 0 of an empty database."""
    names = inspect(engine).get_table_names()
    if "schema_version" not in names:
        if names:
            raise BadInput(
                f"store holds the tables {', '.join(names)}; allowed: one that tactuator made, or a new file"
            )
        return 0
    with engine.connect() as connection:
        return int(connection.execute(select(schema.schema_version.c.version)).scalar_one())
