"""One interval, felt or not: the up-down rule and von Bekesy's arithmetic, on people drawn by the test's generator."""

import numpy as np
import pytest

from tactuator.errors import BadInput
from tactuator.experiment.protocol.file import parse_protocol
from tactuator.experiment.result.played import attention
from tactuator.experiment.result.thresholds import thresholds
from tactuator.experiment.session.presented_session import PresentedSession, Respondent, run_session
from tactuator.experiment.session.studies import open_session
from tactuator.experiment.store.stored_runs import detection_runs
from tactuator.experiment.trial import BLANK
from tests.experiment.session.apparatuses import PROTOCOL, opened_study

YES_NO = (
    PROTOCOL.replace("steps_db = [4, 2]", "steps_db = [4, 2]\ndown = 1\nup = 1")
    .replace("reversals = 6\naveraged = 4", "reversals = 25\naveraged = 21\naverage = 'mid-runs'")
    .replace("[conditions]", "[paradigm]\nintervals = 1\n[catch]\nblank_share = 0.2\n[conditions]")
    .replace("[30, 90, 210]", "[90]")
    .replace("practice_trials = 2", "practice_trials = 0")
)
THRESHOLD_DB_SL = 7.0


class Person(Respondent):
    """Feels a level with the probability of a logistic function, and nothing at all `alarms` of the time."""

    def __init__(self, alarms: float) -> None:
        self.rng, self.alarms = np.random.default_rng(3), alarms

    def respond(self, trial) -> str:
        blank = BLANK in trial.stimuli
        felt = 0.0 if blank else 1.0 / (1.0 + np.exp(-(trial.placement.level_db_sl - THRESHOLD_DB_SL) / 1.2))
        return "1" if self.rng.random() < max(felt, self.alarms) else "0"


def result(store, clock, alarms):
    session = open_session(opened_study(store, clock, YES_NO), "S1")
    session.give_consent()
    run_session(PresentedSession(session), Person(alarms), rest=clock.wait)
    runs = detection_runs(store)
    return thresholds(runs)[0], attention(runs[0])


def test_yes_no__of_a_person_who_says_yes_to_little_else__finds_the_level_felt_half_of_the_time(store, clock) -> None:
    one, flags = result(store, clock, 0.0)
    assert one.point == pytest.approx(0.5, abs=1e-3)
    assert one.own_db_sl == pytest.approx(THRESHOLD_DB_SL, abs=1.0)
    assert one.refit_low_db_sl < THRESHOLD_DB_SL < one.refit_high_db_sl
    assert flags == ()


def test_yes_no__of_a_person_who_says_yes_to_nothing__is_flagged(store, clock) -> None:
    assert result(store, clock, 0.5)[1] == ("attention",)
    protocol = parse_protocol(YES_NO)
    assert (protocol.paradigm.responses, protocol.paradigm.guess) == (("1", "0"), 0.02)
    with pytest.raises(BadInput, match="held with 3 intervals; allowed: with one interval"):
        parse_protocol(YES_NO.replace("intervals = 1", "intervals = 3\nheld = true"))
