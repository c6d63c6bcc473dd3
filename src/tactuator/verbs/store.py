"""The parts of the verb `experiment` on stores as a whole: verify, backup, merge."""

from collections.abc import Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass
from getpass import getuser
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from tactuator.errors import BadInput
from tactuator.table import ResultTable
from tactuator.verbs.experiment import OperatorName
from tactuator.verbs.parameters import Argument, Option, Place
from tactuator.verbs.result import Result

if TYPE_CHECKING:
    from tactuator.experiment.store.chain import Altered
    from tactuator.experiment.store.merge import Conflict

StoreArgument = Annotated[
    Place, Argument("Store of the experiment: a file, or postgresql://...", metavar="STORE", type=str)
]


@dataclass(frozen=True, eq=False, repr=False)
class VerifiedResult(Result):
    """Rows of a store that are not as the program wrote them, in the order of writing; head: the chain's end."""

    store: str
    rows: int
    head: str
    altered: tuple["Altered", ...]

    @property
    def holds(self) -> bool:
        """Return whether every row is as it was written."""
        return not self.altered

    def tables(self) -> Sequence[ResultTable | str]:
        said: list[ResultTable | str] = [f"{self.rows} rows were written; head: {self.head}"]
        if self.holds:
            return [*said, "every row is as it was written"]
        first = self.altered[0]
        rows = [(each.table, str(each.row), each.what, str(each.link or "none")) for each in self.altered[:20]]
        said.append(f"the first altered row is row {first.row} of {first.table}: {first.what}")
        return [*said, ResultTable(f"altered: {len(self.altered)}", ("table", "row", "how", "link"), tuple(rows))]


def verify(
    store: StoreArgument,
    head: Annotated[str | None, Option("Head that was kept: it has to be there.", metavar="NUMBER:SHA256")] = None,
) -> VerifiedResult:
    """Tell which rows of a store were altered. Rows are held against the chain of hashes that was written with them;
    rows that were taken away at the end are found by a head that was kept elsewhere.

    Raises BadInput for a head of another form.
    """
    from tactuator.experiment.store.store import Store

    with closing(Store(store, must_exist=True, whole=False)) as database:
        return _verified(database, head)


def _verified(database: Any, head: str | None = None) -> VerifiedResult:
    from tactuator.experiment.store.chain import altered_rows, head_of

    with database.read() as connection:
        altered, last = altered_rows(connection, None if head is None else head_of(head))
    return VerifiedResult(database.name, last[0], f"{last[0]}:{last[1]}", tuple(altered))


@dataclass(frozen=True, eq=False, repr=False)
class BackupResult(Result):
    """A whole copy of a store, which was read again and verified."""

    verified: VerifiedResult

    @property
    def holds(self) -> bool:
        """Return whether every row of the copy is as it was written."""
        return self.verified.holds

    def to_dict(self) -> dict[str, Any]:
        return self.verified.to_dict()

    def tables(self) -> Sequence[ResultTable | str]:
        return self.verified.tables()


def backup(
    store: StoreArgument, out: Annotated[Place, Argument("File to write.", metavar="OUT", writes=True)]
) -> BackupResult:
    """Copy a store whole, also while it is served. The copy is verified; its head is worth keeping elsewhere.

    Raises BadInput where the place cannot be written.
    """
    from tactuator.experiment.store.store import Store

    with closing(Store(store, must_exist=True, whole=False)) as database:
        database.backup(Path(out))
    with closing(Store(Path(out), must_exist=True)) as copy:
        return BackupResult(_verified(copy))


@dataclass(frozen=True, eq=False, repr=False)
class MergedResult(Result):
    """Stores that were merged into one. rows: those that were new there, for each store. conflicts: what two stores
    have, and not the same; of each, what was there first stays.
    """

    out: str
    rows: Mapping[str, int]
    conflicts: tuple["Conflict", ...]

    @property
    def holds(self) -> bool:
        """Return whether nothing contradicted."""
        return not self.conflicts

    def tables(self) -> Sequence[ResultTable | str]:
        said: list[ResultTable | str] = [f"{name}: {count} rows to {self.out}" for name, count in self.rows.items()]
        rows = tuple((each.table, each.what) for each in self.conflicts)
        return [*said, ResultTable("not the same in both", ("table", "what"), rows)] if rows else said


def merge(
    stores: Annotated[list[str], Argument("Stores to merge: files, or postgresql://...", metavar="STORE...")],
    out: Annotated[str, Option("Store to merge them into, made if it is not there.")],
    operator: OperatorName = None,
) -> MergedResult:
    """Merge stores of several sites or stations into one. What is there already stays, so a merge may be repeated with
    newer stores. Raises BadInput for a store whose rows were altered.
    """
    from tactuator.experiment.session.task import SystemClock
    from tactuator.experiment.store.merge import merge as merged
    from tactuator.experiment.store.records import note
    from tactuator.experiment.store.store import Store, opened_store, sessions_of

    rows: dict[str, int] = {}
    conflicts: tuple[Conflict, ...] = ()
    with sessions_of(out), opened_store(out) as target:
        for place in stores:
            with closing(Store(place, must_exist=True)) as source:
                verified = _verified(source)
                if not verified.holds:
                    first = verified.altered[0]
                    raise BadInput(f"store {place}: row {first.row} of {first.table} was altered", "a sound store")
                done = merged(source, target)
            rows[source.name], conflicts = done.rows, conflicts + done.conflicts
            if done.rows:
                detail = f"{source.name}: {done.rows} rows, head {verified.head}"
                with target.begin() as connection:
                    note(connection, None, "merged", detail, SystemClock().utc(), operator or getuser())
    return MergedResult(str(out), rows, conflicts)
