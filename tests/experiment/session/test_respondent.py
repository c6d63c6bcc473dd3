"""Respondents who are at no browser, and the rigs at which they can sit."""

import numpy as np
import pytest
from sqlalchemy import select

from tactuator.errors import BadInput
from tactuator.experiment.protocol.file import parse_recognition
from tactuator.experiment.result.confusion import recognition_results
from tactuator.experiment.session.presented_session import Respondent
from tactuator.experiment.session.task import Apparatus
from tactuator.experiment.simulated.sitting import ErringRespondent
from tactuator.experiment.store import records, schema
from tactuator.experiment.store.store import Store
from tactuator.rig.open import open_rig
from tactuator.rig.rig import require_finger_ports
from tactuator.rig.simulated import SimulatedRig
from tests.experiment.session.feeling import FeelingRespondent
from tests.experiment.session.recognising import Opened, controller, items, opened, protocol_text  # noqa: F401


class Unwilling(ErringRespondent):
    def agree(self, consent):
        assert consent == "Agreed?"
        return False


def test_run_session__no_consent__ends_at_once_and_stores_nothing(opened) -> None:
    study, _, store = opened(protocol_text(consent="Agreed?"))
    assert study.run("S1", Unwilling(0.0, np.random.default_rng(0))) == 0
    with store.read() as connection:
        assert connection.execute(select(schema.run)).all() == []
        row = records.sessions(connection, study.study.id)[0]
    assert (row.consented_utc, row.ended) == (None, "declined")


def test_run_session__respondent__is_told_of_runs_breaks_and_right_answers_in_order(opened) -> None:
    told = []

    class Telling(Respondent):
        def pause(self):
            told.append("break")

        def begin(self, following):
            told.append(following.planned.title)

        def respond(self, trial):
            told.append("?")
            return trial.correct

        def learn(self, trial, acknowledged):
            told.append(acknowledged.right == trial.correct)

    study, _, _ = opened(protocol_text(test=1))
    assert study.run("S1", Telling()) == 6
    training = [item for _ in range(3) for item in ("?", True)]
    assert told == ["Block 1 of 2: training", *training, "break", "Block 2 of 2: test", "?", "?", "?"]


def test_run_session__board_in_this_process__is_felt_at_its_ports(controller, items, tmp_path) -> None:
    text = protocol_text(training=2, test=4)
    rig, store = open_rig("in-process", controller.display, 1), Store(tmp_path / "lab.db")
    rig.load(controller)
    study = Opened(parse_recognition(text), text, items, Apparatus(rig, controller, "in-process"), store)
    subject = FeelingRespondent("recognition", controller.display, np.random.default_rng(2))
    require_finger_ports(rig, "in-process")
    subject.listen(rig)
    assert study.run("S1", subject) == 18
    (result,), _ = recognition_results(store, np.random.default_rng(0))
    assert result.information.share_correct > 0.9
    rig.close()
    store.close()


def test_require_finger_ports__display_that_is_real__is_refused(controller) -> None:
    rig = SimulatedRig(controller.display)
    require_finger_ports(rig, "simulated")
    rig._fingers = ()
    with pytest.raises(
        BadInput, match="simulated subjects at board:COM3; allowed: at a rig whose display is simulated"
    ):
        require_finger_ports(rig, "board:COM3")
