"""Erasure of a person: no byte of their names is left in any file of the store."""

from contextlib import closing
from pathlib import Path

import pytest
from sqlalchemy import func, insert, select, update

from tactuator.api.experiment import erase, export
from tactuator.errors import BadInput
from tactuator.experiment.session.studies import Correction
from tactuator.experiment.store import schema
from tactuator.experiment.store.erasure import _Scrub
from tactuator.experiment.store.records import CONSENT_NAME, Change, note
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


NAMES = ("Zaphod77", "ZAPHOD77", "outside-4711", "former-0815", "scar-on-Thumb", "burnt-finger", "Zoe Zwick")
TEXT = f"as {', '.join(NAMES)}, who is a calm one beside S1, said"


def written_everywhere(path: Path) -> set[str]:
    """Write TEXT wherever people write, and return the columns; S1 and a note are names of two people."""
    session, subject, clock = schema.session, schema.subject, ObedientClock()
    with opened_store(path) as store, store.begin() as connection:
        people = {row.code: row.id for row in connection.execute(select(subject))}
        mine = select(session.c.id).where(session.c.subject_id == people["Zaphod77"])
        for name in ("Zoe Zwick", "S1", "a"):
            note(connection, connection.execute(mine).scalar(), CONSENT_NAME, name, clock.utc(), "subject Zaphod77")
        change = Change("note", "calm", "burnt-finger")
        note(connection, None, "corrected", "", clock.utc(), "EX", subject=people["Zaphod77"], change=change)
        fact = {"subject_id": people["S1"], "name": "note", "unit": "", "value": "calm"}
        connection.execute(insert(schema.demographic).values(**fact))
        fact = {"subject_id": people["S2"], "name": "note", "unit": "", "value": TEXT}
        connection.execute(insert(schema.demographic).values(**fact))
        note(connection, None, "amended", TEXT, clock.utc(), TEXT, change=Change("note", TEXT, TEXT))
        others = select(session.c.id).where(session.c.subject_id == people["S1"])
        connection.execute(insert(schema.void).values(session_id=connection.execute(others).scalar(), reason=TEXT))
        connection.execute(update(schema.protocol_version).values(reason=TEXT))
    return {"demographic.value", *(f"event.{name}" for name in ("who", "detail", "before", "after")),
            "void.reason", "protocol_version.reason"}  # fmt: skip


def test_erase__named_in_texts_of_others__is_replaced_in_every_one_and_nobody_else_is(tmp_path) -> None:
    path = tmp_path / "lab.db"
    filled(path)
    written = written_everywhere(path)
    columns = [column for table in schema.tables.sorted_tables for column in table.columns]
    assert written == {f"{each.table.name}.{each.name}" for each in columns if isinstance(each.type, schema.Prose)}
    told = " ".join(erase(path, "Zaphod77", operator="EX").notices())
    assert [name for name in NAMES if name.casefold() not in told.casefold()] == []
    assert "search for 'Zaphod77'" in told
    assert "may still describe" in told
    left = bytes_of(tmp_path).lower()
    assert [name for name in NAMES if name.lower().encode() in left] == []
    with closing(Store(path, must_exist=True)) as store, store.read() as connection:
        (reason,) = connection.execute(select(schema.protocol_version.c.reason)).scalars()
        assert [row.code for row in connection.execute(select(schema.subject))] == ["S1", "S2"]
    assert reason.endswith("who is a calm one beside S1, said")


def test_scrub__name_in_a_value_too__goes_from_the_comments_alone() -> None:
    text = 'site = "Zaphod77"\n# for zaphod77, not Zaphod778\nnote = """\n# Zaphod77\n"""\n'
    assert _Scrub({"Zaphod77"}).protocol(text) == text.replace("for zaphod77,", "for erased,")
