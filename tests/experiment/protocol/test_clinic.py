"""A clinic's limits: for the day, for a standard's conditions, and the names of who consents."""

from dataclasses import replace

import pytest
from sqlalchemy import select

from tactuator.errors import BadInput
from tactuator.experiment.export import export
from tactuator.experiment.protocol.clinic import Gates
from tactuator.experiment.protocol.file import parse_protocol
from tactuator.experiment.session.presented_session import PresentedSession
from tactuator.experiment.session.studies import open_session
from tactuator.experiment.store import records, schema
from tests.experiment.session.apparatuses import PROTOCOL, ObedientClock, answer_one, controller, opened_study, rows_of

GATES = (
    '\n[gates]\nskin_temperature_low_c = 27\nskin_temperature_high_c = 36\npreload_high_n = 0.5\nposture = "seated"\n'
)
TEXT = PROTOCOL + GATES
SITTING = records.Sitting("person", "")


def of_study(store, text):
    study = opened_study(store, ObedientClock(), text)
    return study, next(row for row in study.sessions() if row.subject_code == "S1")


def test_gates__data_of_the_day__are_compared_with_every_limit() -> None:
    for day, unmet in (
        ((30.0, 0.2, "seated"), []),
        ((27.0, 0.5, "seated"), []),
        ((12.0, 0.2, "seated"), ["skin_temperature_c: 12 °C (allowed: 27 to 36 °C)"]),
        ((30.0, 0.6, "seated"), ["preload_n: 0.6 N (allowed: at most 0.5 N)"]),
        ((30.0, None, ""), ["preload_n: not given (allowed: at most 0.5 N)", "posture: not given (allowed: seated)"]),
    ):
        assert [str(limit) for limit in parse_protocol(TEXT).gates.unmet(*day)] == unmet
    with pytest.raises(BadInput, match="a low limit up to the high one"):
        Gates(skin_temperature_low_c=36.0, skin_temperature_high_c=27.0)


@pytest.mark.parametrize("only_tells", [False, True])
def test_run__outside_the_gates__does_not_begin_or_begins_with_an_event(store, only_tells) -> None:
    study, row = of_study(store, TEXT.replace("[gates]", '[gates]\noutside = "tell"') if only_tells else TEXT)
    session = study.session(row, SITTING)
    session.give_consent()
    at, clock = PresentedSession(session), study.clock
    study.set_day(row.id, 12.0, 0.2, posture="seated")
    if not only_tells:
        with pytest.raises(BadInput, match=r"12 °C \(allowed: 27 to 36 °C\)"):
            answer_one(at, clock)
        study.set_day(row.id, 31.0, 0.2, posture="seated")
    assert answer_one(at, clock) == (0, 0)
    study.set_day(row.id, 12.0, 0.2, posture="seated")
    assert answer_one(at, clock) == (0, 1)  # a run that goes on is not cut in two
    told = [detail for (detail,) in rows_of(store, select(schema.event.c.detail).where(schema.event.c.kind == "gate"))]
    assert told == ["skin_temperature_c: 12 °C (allowed: 27 to 36 °C)"] * only_tells


def test_standard__every_condition_unmet_or_not_compared__is_told() -> None:
    text = PROTOCOL + "\n[standard]\nsource = 'own copy'\ncontact_high_mm2 = 20\nramp_low_s = 0.5\n"
    told = [str(one) for one in parse_protocol(text).unmet()]
    assert told[:3] == [f"frequency: none (allowed: {hertz} Hz)" for hertz in ("4", "31.5", "125")]
    assert "contact area: 78.5 mm² (allowed: at most 20 mm²)" in told
    assert "ramp: 0.01 s (allowed: at least 0.5 s)" in told
    assert "stimulus: 0.05 s (allowed: no limit given, not compared)" in told
    assert "surround: none (allowed: no limit given, not compared)" in told
    assert parse_protocol(PROTOCOL).unmet() == []


def test_standard__conditions_that_the_display_does_not_meet__are_kept_with_the_session(store) -> None:
    limits = "contact_high_mm2 = 20\nsurround = 'rigid'\nramp_low_s = 0.012\nfrequencies_hz = [30, 400]\n"
    study, row = of_study(store, PROTOCOL + "\n[standard]\n" + limits)
    session = study.session(row, SITTING)
    session.give_consent()
    for _ in range(2):
        answer_one(PresentedSession(session), study.clock)
    with store.read() as connection:
        assert records.details(connection, row.id, "standard") == [
            "the display's band: 0.4 to 300 Hz (allowed: 400 Hz within it)",
            "the display's contact area: not given (allowed: at most 20 mm²)",
            "the display's surround: not given (allowed: rigid)",
            "the ramp at 90 Hz: 0.01 s (allowed: at least 0.012 s)",
            "the ramp at 210 Hz: 0.01 s (allowed: at least 0.012 s)",
        ]
    protocol = parse_protocol(PROTOCOL + "\n[standard]\ncontact_high_mm2 = 20\nfrequencies_hz = [30]\n")
    channel = controller().display.channels[0]
    small, large = (replace(channel, contact=replace(channel.contact, area_mm2=area)) for area in (12.0, 25.0))
    assert protocol.unmet_by(small) == []
    assert list(map(str, protocol.unmet_by(large))) == ["the display's contact area: 25 mm² (allowed: at most 20 mm²)"]


def test_group__of_any_name__is_allowed_and_of_none_refused() -> None:
    for group in ("neuropathy", "Diabetes mellitus 2", "hearing-impaired", "contrôle"):
        text = PROTOCOL.replace('group = "hearing"', f'group = "{group}"')
        assert parse_protocol(text).subject[0].group == group
    for group in ("", " led", "a" * 65, "=SUM(A1)", "a,b", 'a\\"b'):
        with pytest.raises(BadInput, match="1 to 64 letters"):
            parse_protocol(PROTOCOL.replace('group = "hearing"', f'group = "{group}"'))


def test_consent__by_name_with_a_witness__needs_both_and_is_in_no_export(store, tmp_path) -> None:
    text = PROTOCOL.replace("[study]", '[study]\nconsent_by = "name"\nconsent_witness = true')
    study, _ = of_study(store, text)
    session = open_session(study, "S1")
    for names in ((), ("Ada Example",), ("  ", "Bob Example")):
        with pytest.raises(BadInput, match="consent without a"):
            session.give_consent(*names)
        assert session.stage == "consent"
    session.give_consent("Ada Example", "Bob Example")
    assert session.stage == "trial"
    answer_one(PresentedSession(session), study.clock)
    told = select(schema.event.c.detail).where(schema.event.c.kind == records.CONSENT_NAMES)
    assert rows_of(store, told) == [("name: Ada Example; witness: Bob Example",)]
    export(store, tmp_path / "out", "tidy")
    written = "".join(file.read_text() for file in (tmp_path / "out").rglob("*") if file.suffix in (".csv", ".tsv"))
    assert "Example" not in written
