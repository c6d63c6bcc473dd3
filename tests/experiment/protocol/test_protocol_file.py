"""Protocol files of either kind, told apart by their content."""

import pytest

from tactuator.errors import BadInput
from tactuator.experiment.protocol.file import read_any_protocol, read_protocol, read_recognition
from tactuator.experiment.session.detection_task import DetectionTask
from tactuator.experiment.session.recognition_task import RecognitionTask
from tactuator.experiment.session.studies import task_of
from tests.experiment.session.apparatuses import PROTOCOL, apparatus
from tests.experiment.session.recognising import controller, items, opened_apparatus, protocol_text  # noqa: F401


def test_protocol__of_either_kind__is_recognised_by_its_content(tmp_path, items, controller) -> None:
    for name, text, kind in (("d", PROTOCOL, DetectionTask), ("i", protocol_text(), RecognitionTask)):
        path = tmp_path / f"{name}.toml"
        path.write_text(text)
        read, own = read_any_protocol(path)
        assert own == text
        place = apparatus() if kind is DetectionTask else opened_apparatus(controller)
        assert isinstance(task_of(read, items, place), kind)


@pytest.mark.parametrize(
    ("read", "text", "message"),
    [
        (read_protocol, protocol_text(), "allowed: a detection protocol"),
        (read_recognition, PROTOCOL, "allowed: a recognition protocol"),
        (read_recognition, "", "has the tables none"),
        (read_any_protocol, "[study", "allowed: TOML"),
        (read_any_protocol, '[[item]]\nlabel = "a"', "study"),
        (read_any_protocol, PROTOCOL + "[extra]\nx = 1\n", "extra"),
        (read_any_protocol, protocol_text(extra="[session]\nbreak_s = -1\n"), "session.break_s"),
        (read_any_protocol, protocol_text(subjects=("S1", "S1")), "subject codes S1, S1; allowed: each once"),
        (read_any_protocol, PROTOCOL.replace('"S2"', '"S1"'), "subject codes S1, S1; allowed: each once"),
    ],
)
def test_protocol__of_the_wrong_kind_or_amiss__is_refused_in_one_line(tmp_path, read, text, message) -> None:
    (tmp_path / "p.toml").write_text(text)
    with pytest.raises(BadInput, match=message) as refusal:
        read(tmp_path / "p.toml")
    assert "\n" not in str(refusal.value)
