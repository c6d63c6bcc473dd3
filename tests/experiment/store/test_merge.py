"""Stores merged, and stations that share one: nothing lost, nothing doubled, contradictions told."""

import shutil
import socket
import sqlite3
import threading
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

import pytest

from tactuator.errors import BadInput, StoreFault
from tactuator.experiment.export import export
from tactuator.experiment.result.store_results import store_results
from tactuator.experiment.session.studies import Correction
from tactuator.experiment.store.merge import Shared
from tactuator.experiment.store.store import Store, opened_store
from tactuator.verbs.store import merge, verify
from tests.experiment.session.apparatuses import (
    PROTOCOL,
    ObedientClock,
    answer_one,
    answers,
    begin,
    everything,
    opened_study,
)
from tests.postgres import PostgresServer

pytestmark = pytest.mark.xdist_group("postgres")
SHORT = PROTOCOL.replace("frequencies_hz = [30, 90, 210]", "frequencies_hz = [90]").replace("practice_trials = 2\n", "")


def site(path: Path, subject: int, trials: int) -> Path:
    """A store of its own, in which that subject answered."""
    clock = ObedientClock()
    with opened_store(path) as store:
        presented = begin(store, clock, SHORT, subject)
        for _ in range(trials):
            answer_one(presented, clock)
    return path


def test_merge__of_two_sites__has_every_answer_once_however_often(tmp_path) -> None:
    sites = [str(site(tmp_path / f"{name}.db", subject, 5)) for subject, name in enumerate("ab")]
    alone = shutil.copy(sites[1], tmp_path / "alone.db")
    out = tmp_path / "c.db"
    result = merge(sites, str(out))
    assert (result.holds, min(result.rows.values()) > 5 * 4) == (True, True)
    assert sorted(answers(out)) == sorted([*answers(sites[0]), *answers(sites[1])])
    assert len(answers(out)) == 10
    assert set(merge([*sites, *sites], str(out)).rows.values()) == {0}
    assert len(answers(out)) == 10
    assert verify(out).holds
    with closing(Store(sites[1])) as store:
        opened_study(store, ObedientClock(), SHORT).correct("S1", Correction(group="unknown"), "wrong", "Ada")
    (conflict,) = merge(sites, str(tmp_path / "d.db")).conflicts
    assert conflict.what == "subject S1: subject_group is 'hearing' there and 'unknown' here"
    with closing(sqlite3.connect(alone)) as plain, plain:
        plain.execute("UPDATE subject SET subject_group = 'unknown' WHERE code = 'S1'")
    with pytest.raises(BadInput, match=r"alone.db: row 1 of subject was altered; allowed: a sound store"):
        merge([alone], str(tmp_path / "e.db"))
    assert not (tmp_path / "e.db").exists()


def test_merge__of_a_store_that_went_on__brings_what_is_new(tmp_path) -> None:
    path, out, clock = tmp_path / "a.db", tmp_path / "c.db", ObedientClock()
    with opened_store(path) as store:
        for trials in (9, 9):
            begin(store, clock, SHORT, trials=trials)
            merge([str(path)], str(out))
        everything(begin(store, clock, SHORT), clock)
        opened_study(store, clock, SHORT).correct("S1", Correction(group="unknown"), "typing error", "Ada")
    merge([str(path)], str(out))
    assert sorted(answers(out)) == sorted(answers(path))
    assert store_results(out).document() == store_results(path).document()
    with closing(sqlite3.connect(out)) as plain:
        assert plain.execute("SELECT subject_group FROM subject WHERE code = 'S1'").fetchone() == ("unknown",)
        assert plain.execute("SELECT who, count(*) FROM event WHERE kind = 'correction'").fetchone() == ("Ada", 1)


def test_merge__visit_begun_at_both__is_told_and_the_first_stays(tmp_path) -> None:
    sites = [str(site(tmp_path / f"{name}.db", 0, count)) for name, count in (("a", 5), ("b", 3))]
    result = merge(sites, str(tmp_path / "c.db"))
    assert [conflict.what for conflict in result.conflicts] == ["subject S1, visit 1 was begun in two stores"]
    assert not result.holds
    assert sorted(answers(tmp_path / "c.db")) == sorted(answers(sites[0]))


def test_merge__older_copy_that_went_another_way__is_refused(tmp_path) -> None:
    path, out, clock = tmp_path / "a.db", tmp_path / "c.db", ObedientClock()
    site(path, 0, 3)
    older = Path(shutil.copy(path, tmp_path / "older.db"))
    with opened_store(path) as store:
        answer_one(begin(store, clock, SHORT), clock)
    merge([str(path)], str(out))
    with pytest.raises(BadInput, match="older copy"):
        merge([str(older)], str(out))
    with pytest.raises(BadInput, match="or a copy of it"):
        merge([str(older)], str(path))


@pytest.fixture(scope="module")
def server() -> Iterator[PostgresServer]:
    made = PostgresServer()
    yield made
    made.close()


def test_stations__server_lost_in_between__share_every_answer_once(tmp_path, server) -> None:
    place, clock = server.database("lost"), ObedientClock()
    paths = [tmp_path / "one.db", tmp_path / "two.db"]
    with opened_store(paths[0]) as one, opened_store(paths[1]) as two:
        first, second = Shared(one, place), Shared(two, place)
        presented = [begin(one, clock, SHORT, 0)]
        first.exchange()
        second.exchange()
        presented.append(begin(two, clock, SHORT, 1))
        for each in presented:
            answer_one(each, clock)
        second.exchange()
        server.kill()
        for each in presented:
            answer_one(each, clock)
        with pytest.raises(StoreFault):
            first.exchange()
        server.start()
        assert first.exchange().conflicts == second.exchange().conflicts == ()
        with pytest.raises(BadInput, match="goes on at another station"):
            begin(two, clock, SHORT, 0).session.next_trial()
        with pytest.raises(BadInput, match="goes on at another station"):
            begin(one, clock, SHORT, 1).session.next_trial()
        for sharing in (first, second):
            sharing.close()
    assert sorted(answers(place)) == sorted([*answers(paths[0]), *answers(paths[1])])
    assert len(answers(place)) == 4
    assert verify(place).holds
    with closing(Store(place)) as store:
        assert export(store, tmp_path / "out", "tidy") == 4


@pytest.mark.parametrize("answer", [b"+OK ready\r\n", b"\0\0\0\x34\0\3\0\0"])
def test_server__that_is_not_there_or_another_program_or_an_echo__is_refused_in_one_line(answer: bytes) -> None:
    with pytest.raises(BadInput, match="allowed: a PostgreSQL database that is there and lets one in"):
        Store("postgresql://lab@127.0.0.1:9/nothing")
    with socket.create_server(("127.0.0.1", 0)) as other:

        def speak() -> None:
            talking, _ = other.accept()
            with talking:
                talking.sendall(answer)
                while talking.recv(999):  # as long as it is listened to
                    pass

        speaking = threading.Thread(target=speak)
        speaking.start()
        with pytest.raises(BadInput, match="is no PostgreSQL server; allowed: "):
            Store(f"postgresql://lab@127.0.0.1:{other.getsockname()[1]}/study")
        speaking.join()
