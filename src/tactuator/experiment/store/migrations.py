"""Migrations of a store from one schema version to the next, each in a transaction of its own."""

from __future__ import annotations

from typing import Any

from sqlalchemy import Engine, inspect, select

from tactuator.errors import BadInput
from tactuator.experiment.store import schema, steps

STEPS: tuple[tuple[str, ...], ...] = (
    steps.THRESHOLDS,
    steps.IDENTIFICATION,
    steps.PROTOCOL_VERSIONS,
    steps.CORRECTIONS,
)
"""Statements of each version, the first making an empty database into version 1."""


def migrate(engine: Engine, upto: int = len(STEPS)) -> int:
    """Bring the database to version `upto` and return the version that it had.

    Raises BadInput for a database of a later tool, one that holds other tables and no version, or one with rows that
    refer to rows that are not there; such a store is left as it was.
    """
    had = version(engine)
    if had > len(STEPS):
        raise BadInput(f"store has schema version {had}", f"up to {len(STEPS)} (a later tactuator wrote it)")
    for number in range(had, upto):
        _apply(engine, STEPS[number], number + 1)
    return had


def _apply(engine: Engine, statements: tuple[str, ...], number: int) -> None:
    """Take one step. References are checked at its end, since tables that are made anew are referred to by others."""
    with engine.connect() as connection:
        driver: Any = connection.connection.driver_connection
        driver.execute("PRAGMA foreign_keys = OFF")
        try:
            with connection.begin():
                for statement in statements:
                    connection.exec_driver_sql(statement)
                astray = connection.exec_driver_sql("PRAGMA foreign_key_check").first()
                if astray is not None:
                    raise BadInput(f"store: a row of {astray[0]} refers to a {astray[2]} that is not there")
                connection.execute(schema.schema_version.delete())
                connection.execute(schema.schema_version.insert().values(version=number))
        finally:
            driver.execute("PRAGMA foreign_keys = ON")


def version(engine: Engine) -> int:
    """Return the schema version, 0 of an empty database. Raises BadInput for a database that is not of this tool."""
    names = inspect(engine).get_table_names()
    if "schema_version" not in names:
        if names:
            raise BadInput(f"store holds the tables {', '.join(names)}", "one that tactuator made, or a new file")
        return 0
    with engine.connect() as connection:
        return int(connection.execute(select(schema.schema_version.c.version)).scalar_one())
