"""Protocol files and what is refused by its key; a clinic's limits, conditions and names of who consents."""

from dataclasses import replace
from itertools import pairwise

import pytest
from sqlalchemy import select

from tactuator.errors import BadInput
from tactuator.experiment.export import export
from tactuator.experiment.protocol.clinic import Gates
from tactuator.experiment.protocol.detection import Protocol, latin_square, plan_runs
from tactuator.experiment.protocol.file import RecognitionProtocol, parse_protocol, read_protocol
from tactuator.experiment.protocol.study import StudyProtocol, run_seed
from tactuator.experiment.session.detection_task import DetectionTask
from tactuator.experiment.session.presented_session import PresentedSession
from tactuator.experiment.session.recognition_task import RecognitionTask
from tactuator.experiment.session.studies import open_session, task_of
from tactuator.experiment.store import records, schema
from tests.experiment.session.apparatuses import PROTOCOL, ObedientClock, answer_one, apparatus, opened_study, rows_of
from tests.experiment.session.recognising import controller, items, opened_apparatus, protocol_text  # noqa: F401


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("seed = 7", "seed = -1", "study.seed"),
        ('kind = "up-down"', 'kind = "guess"', "imece2004"),
        ("start_db_sl = 20", "start_db_sl = 70", "start_db_sl"),
        ("frequencies_hz = [30, 90, 210]", "frequencies_hz = []", "one or more"),
        ("frequencies_hz = [30, 90, 210]", "frequencies_hz = [50, 50]", "twice"),
        ("frequencies_hz = [30, 90, 210]", "frequencies_hz = [0]", "frequencies_hz"),
        ('order = "latin-square"', 'order = "any"', "conditions.order"),
        ("ramp_s = 0.01", "ramp_s = 0.04", "ramps of 0.04 s"),
        ('code = "S2"', 'code = "S1"', "each once"),
        ('code = "S2"', 'code = "S 2"', "subject.1.code"),
        ("skin_temperature_c = 31", "skin_temperature_c = 300", "skin_temperature_c"),
        ("practice_trials = 2", "practise_trials = 2", "practise_trials"),
        ("practice_trials = 2", "break_s = inf", "session.break_s"),
        ("practice_trials = 2", "break_s = 86401", "session.break_s"),
        ("resume_within_s = 600", "resume_within_s = nan", "session.resume_within_s"),
        ("resume_within_s = 600", "resume_within_s = 86401", "session.resume_within_s"),
        ('masking_sound = "pink"', 'masking_sound = "brown"', "masking_sound"),
        (
            'kind = "up-down"\nstart_db_sl = 20\nsteps_db = [4, 2]\nreversals = 6\naveraged = 4',
            'kind = "curve"',
            "chooses",
        ),
        ("[study]", "[study", "TOML"),
    ],
)
def test_protocol__nonsense__is_refused_by_key(old: str, new: str, message: str) -> None:
    assert old in PROTOCOL
    with pytest.raises(BadInput, match=message):
        parse_protocol(PROTOCOL.replace(old, new), Protocol)


@pytest.mark.parametrize("count", [2, 3, 4, 7, 8])
def test_latin_square__any_size__balances_places_and_successions(count: int) -> None:
    rows = latin_square(count)
    for place in range(count):
        seen = [row[place] for row in rows]
        assert {seen.count(one) for one in range(count)} == {len(rows) // count}
    successions = [pair for row in rows for pair in pairwise(row)]
    assert {successions.count(pair) for pair in successions} == {len(rows) // count}
    assert len(set(successions)) == count * (count - 1)


def test_plan__of_a_subject__has_practice_first_repeats_and_an_order_and_seeds_of_its_own() -> None:
    text = PROTOCOL.replace('"latin-square"', '"random"').replace("[30, 90, 210]", "[10, 20, 50, 100]")
    drawn = parse_protocol(text, Protocol)
    orders = [tuple(run.frequency_hz for run in plan_runs(drawn, subject)) for subject in range(6)]
    assert len(set(orders)) > 1
    assert orders[2] == tuple(run.frequency_hz for run in plan_runs(drawn, 2))
    runs = plan_runs(parse_protocol(PROTOCOL.replace("[conditions]", "[conditions]\nrepeats = 2"), Protocol), 0)
    assert [(run.practice, run.position) for run in runs] == [(position == 0, position) for position in range(7)]
    assert len({run_seed(drawn, *place) for place in ((0, 1, 0), (0, 1, 1), (1, 1, 0), (0, 2, 0))}) == 4


def test_protocol__of_either_kind__is_recognised_by_its_content(tmp_path, items, controller) -> None:
    for name, text, kind in (("d", PROTOCOL, DetectionTask), ("i", protocol_text(), RecognitionTask)):
        path = tmp_path / f"{name}.toml"
        path.write_text(text)
        read, own = read_protocol(path, StudyProtocol)
        assert own == text
        place = apparatus() if kind is DetectionTask else opened_apparatus(controller)
        assert isinstance(task_of(read, items, place), kind)


@pytest.mark.parametrize(
    ("form", "text", "message"),
    [
        (Protocol, protocol_text(), "allowed: a detection protocol"),
        (RecognitionProtocol, PROTOCOL, "allowed: a recognition protocol"),
        (RecognitionProtocol, "", "has the tables none"),
        (StudyProtocol, "[study", "allowed: TOML"),
        (StudyProtocol, '[[item]]\nlabel = "a"', "study"),
        (StudyProtocol, PROTOCOL + "[extra]\nx = 1\n", "extra"),
        (StudyProtocol, protocol_text(extra="[session]\nbreak_s = -1\n"), "session.break_s"),
        (StudyProtocol, protocol_text(subjects=("S1", "S1")), "subject codes S1, S1; allowed: each once"),
        (StudyProtocol, protocol_text().replace('label = "C-index"', 'label = "M-index"'), "item labels"),
        (StudyProtocol, protocol_text().replace('key = "2"', 'key = "1"'), "keys"),
        (StudyProtocol, protocol_text("guessing"), "paradigm"),
        (StudyProtocol, protocol_text().replace("repetitions = 20", "repetitions = 0"), "repetitions"),
    ],
)
def test_protocol__of_the_wrong_kind_or_amiss__is_refused_in_one_line(tmp_path, form, text, message) -> None:
    for unreadable in (tmp_path / "p.toml", tmp_path):
        with pytest.raises(BadInput, match="protocol"):
            read_protocol(unreadable, form)
    (tmp_path / "p.toml").write_text(text)
    with pytest.raises(BadInput, match=message) as refusal:
        read_protocol(tmp_path / "p.toml", form)
    assert "\n" not in str(refusal.value)


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
        assert [str(limit) for limit in parse_protocol(TEXT, Protocol).gates.unmet(*day)] == unmet
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


def test_standard_and_group__unmet_or_of_any_name__are_told_or_allowed_and_of_none_refused() -> None:
    text = PROTOCOL + "\n[standard]\nsource = 'own copy'\ncontact_high_mm2 = 20\nramp_low_s = 0.5\n"
    told = [str(one) for one in parse_protocol(text, Protocol).unmet()]
    assert told[:3] == [f"frequency: none (allowed: {hertz} Hz)" for hertz in ("4", "31.5", "125")]
    assert "contact area: 78.5 mm² (allowed: at most 20 mm²)" in told
    assert "ramp: 0.01 s (allowed: at least 0.5 s)" in told
    assert "stimulus: 0.05 s (allowed: no limit given, not compared)" in told
    assert "surround: not given (allowed: no limit given, not compared)" in told
    assert parse_protocol(PROTOCOL, Protocol).unmet() == []
    for group in ("neuropathy", "Diabetes mellitus 2", "hearing-impaired", "contrôle"):
        text = PROTOCOL.replace('group = "hearing"', f'group = "{group}"')
        assert parse_protocol(text, Protocol).subject[0].group == group
    for group in ("", " led", "a" * 65, "=SUM(A1)", "a,b", 'a\\"b'):
        with pytest.raises(BadInput, match="1 to 64 letters"):
            parse_protocol(PROTOCOL.replace('group = "hearing"', f'group = "{group}"'), Protocol)


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
    protocol = parse_protocol(PROTOCOL + "\n[standard]\ncontact_high_mm2 = 20\nfrequencies_hz = [30]\n", Protocol)
    channel = apparatus().controller.display.channels[0]
    small, large = (replace(channel, contact=replace(channel.contact, area_mm2=area)) for area in (12.0, 25.0))
    assert protocol.unmet_by(small) == []
    assert list(map(str, protocol.unmet_by(large))) == ["the display's contact area: 25 mm² (allowed: at most 20 mm²)"]


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
