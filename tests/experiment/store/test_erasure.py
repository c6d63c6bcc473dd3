"""Erasure of a person: no byte of their names is left in any file of the store."""

from contextlib import closing
from pathlib import Path

import pytest
from sqlalchemy import func, select

from tactuator.api.experiment import erase, export
from tactuator.errors import BadInput
from tactuator.experiment.session.studies import Correction
from tactuator.experiment.store import schema
from tactuator.experiment.store.store import Store, opened_store
from tests.experiment.session.apparatuses import PROTOCOL, ObedientClock, begin, opened_study

PERSON = """
# Zaphod77 asked for a quiet room
[[subject]] # of the spring
code = "Zaphod77"
participant_id = "outside-4711"
group = "hearing"
[subject.demographics]
note = "scar-on-thumb"
[[demographic]]
name = "note"
label = "Note"
"""
STRINGS = [b"Zaphod77", b"outside-4711", b"scar-on-thumb", b"former-0815", b"burnt-finger", b"Mary Example"]


def filled(path: Path) -> list[bytes]:
    """Make a store with a person among others, and return what it has of them."""
    clock, text = ObedientClock(), PROTOCOL.replace("[[subject]]", PERSON + "[[subject]]", 1)
    with opened_store(path) as store:
        others = begin(store, clock, text, subject=1, trials=3)
        assert others.trials == 3
        assert begin(store, clock, text, subject=0, trials=4).trials == 4
        study = opened_study(store, clock, text)
        with study.editing("EX") as opened:
            values = Correction(participant_id="former-0815", facts={"note": "burnt-finger"})
            opened.correct("Zaphod77", values, "Mary Example said so")
            opened.correct("Zaphod77", Correction(participant_id="outside-4711"), "Mary Example said so")
        with store.read() as connection:
            token = select(schema.session.c.link_token).join(schema.subject)
            tokens = connection.execute(token.where(schema.subject.c.code == "Zaphod77")).scalars()
            return [token.encode() for token in tokens]


def bytes_of(folder: Path) -> bytes:
    return b"".join(path.read_bytes() for path in sorted(folder.rglob("*")) if path.is_file())


def counts(path: Path) -> dict[str, int]:
    with closing(Store(path, must_exist=True)) as store, store.read() as connection:
        tables = schema.tables.sorted_tables
        return {
            table.name: connection.execute(select(func.count()).select_from(table)).scalar_one() for table in tables
        }


def test_erase__person_of_several__leaves_no_byte_and_everything_of_the_others(tmp_path) -> None:
    path = tmp_path / "lab" / "lab.db"
    path.parent.mkdir()
    strings = STRINGS + filled(path)
    found = [text for text in strings if text in bytes_of(path.parent)]
    assert found == strings
    before = counts(path)
    erased = erase(path, "Zaphod77", operator="EX")
    assert (erased.visits, erased.trials) == (1, 4)
    export(path, tmp_path / "lab" / "tidy")
    assert [text for text in strings if text in bytes_of(path.parent)] == []
    after = counts(path)
    assert (before["trial"] - after["trial"], before["response"] - after["response"]) == (4, 4)
    assert before["subject"] - after["subject"] == before["session"] - after["session"] == 1
    assert after["trial"] == 3
    assert b"1 visits" in (tmp_path / "lab" / "tidy" / "events.csv").read_bytes()
    with pytest.raises(BadInput, match="Zaphod77"):
        erase(path, "Zaphod77")
