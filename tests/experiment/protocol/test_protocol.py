"""Protocol files and what is refused by its key; groups; names of who consents."""

from itertools import pairwise

import pytest
from sqlalchemy import select

from tactuator.errors import BadInput
from tactuator.experiment.export import export
from tactuator.experiment.protocol.detection import Protocol, latin_square
from tactuator.experiment.protocol.file import RecognitionProtocol, parse_protocol, read_protocol
from tactuator.experiment.protocol.study import StudyProtocol
from tactuator.experiment.session.recognition_task import RecognitionTask
from tactuator.experiment.session.studies import open_session, task_of
from tactuator.experiment.session.tone_task import DetectionTask
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


def test_plan__of_a_subject__has_practice_first_and_seeds_of_its_own() -> None:
    text = PROTOCOL.replace('"latin-square"', '"random"').replace("[30, 90, 210]", "[10, 20, 50, 100]")
    drawn = parse_protocol(text, Protocol)
    orders = [tuple(run.frequency_hz for run in drawn.runs(subject)) for subject in range(6)]
    assert len(set(orders)) > 1
    assert orders[2] == tuple(run.frequency_hz for run in drawn.runs(2))
    runs = parse_protocol(PROTOCOL.replace("[conditions]", "[conditions]\nrepeats = 2"), Protocol).runs(0)
    assert [(run.practice, run.position) for run in runs] == [(position == 0, position) for position in range(7)]
    assert len({drawn.run_seed(*place) for place in ((0, 1, 0), (0, 1, 1), (1, 1, 0), (0, 2, 0))}) == 4


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
        (Protocol, protocol_text(), "a detection protocol"),
        (RecognitionProtocol, PROTOCOL, "a recognition protocol"),
        (RecognitionProtocol, "", "has the tables none"),
        (StudyProtocol, "[study", "TOML"),
        (StudyProtocol, '[[item]]\nlabel = "a"', "study"),
        (StudyProtocol, PROTOCOL + "[extra]\nx = 1\n", "extra"),
        (StudyProtocol, protocol_text(extra="[session]\nbreak_s = -1\n"), "session.break_s"),
        (StudyProtocol, protocol_text(subjects=("S1", "S1")), "subject codes S1, S1; expected each once"),
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


def test_group__of_any_name__is_allowed_and_of_none_refused() -> None:
    for group in ("neuropathy", "Diabetes mellitus 2", "hearing-impaired", "contrôle"):
        text = PROTOCOL.replace('group = "hearing"', f'group = "{group}"')
        assert parse_protocol(text, Protocol).subject[0].group == group
    for group in ("", " led", "a" * 65, "=SUM(A1)", "a,b", 'a\\"b'):
        with pytest.raises(BadInput, match="1 to 64 letters"):
            parse_protocol(PROTOCOL.replace('group = "hearing"', f'group = "{group}"'), Protocol)


def test_consent__by_name__needs_one_and_it_is_in_no_export(store, tmp_path) -> None:
    clock = ObedientClock()
    study = opened_study(store, clock, PROTOCOL.replace("[study]", '[study]\nconsent_by = "name"'))
    session = open_session(study, "S1")
    for name in ("", "  "):
        with pytest.raises(BadInput, match="consent without a name"):
            session.give_consent(name)
        assert session.stage == "consent"
    session.give_consent("Ada Example")
    assert session.stage == "trial"
    answer_one(session, clock)
    told = select(schema.event.c.detail).where(schema.event.c.kind == records.CONSENT_NAME)
    assert rows_of(store, told) == [("Ada Example",)]
    export(store, tmp_path / "out", "tidy")
    written = "".join(file.read_text() for file in (tmp_path / "out").rglob("*") if file.suffix in (".csv", ".tsv"))
    assert "Example" not in written
