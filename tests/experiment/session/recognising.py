"""A recognition study on one simulated finger: its items, its protocol, and a subject's way through it."""

import tomllib
from contextlib import ExitStack

import pytest

from tactuator.experiment.protocol.file import RecognitionProtocol, parse_protocol
from tactuator.experiment.protocol.recognition import block_trials
from tactuator.experiment.session.recognition_task import RecognitionTask
from tactuator.experiment.session.respondent import run_session
from tactuator.experiment.session.studies import open_session, open_study
from tactuator.experiment.session.task import Apparatus
from tactuator.experiment.store import records
from tactuator.experiment.store.store import opened_store
from tactuator.io.display import parse_display
from tactuator.rig.open import open_rig
from tactuator.rig.simulated import SimulatedRig
from tactuator.speech.items import Component, WaveformSet, write_waveforms
from tactuator.synthesis.design import design_controller
from tests.experiment.session.apparatuses import ObedientClock, nobody, token
from tests.one_finger import DISPLAY

SET = WaveformSet(0.125, components=(Component("M", 30.0, 40.0), Component("C", 240.0, 40.0)), fingers=(("index",),))
LONGER = WaveformSet(0.25, components=(Component("L", 60.0, 40.0),), fingers=(("index",),))
"""One waveform, L-index, that takes twice as long."""


class Ticking(ObedientClock):
    """A clock that goes on by a second each time it is asked."""

    def utc(self):
        self.wait(1.0)
        return self.now


def write_items(controller, folder):
    for one in (SET, LONGER):
        write_waveforms(one, controller, folder)


def protocol_text(paradigm="recognition", training=1, test=20, subjects=("S1",), labels=None, consent="", extra=""):
    """Items by label from files of that name, a block of training with feedback and one of test without."""
    items = "".join(
        f'[[item]]\nlabel = "{label}"\nfile = "{label}.wav"\nkey = "{key}"\n'
        for key, label in enumerate(labels or SET.labels(), start=1)
    )
    blocks = "".join(
        f'[[block]]\nkind = "{kind}"\nrepetitions = {count}\nfeedback = {"true" if kind == "training" else "false"}\n'
        for kind, count in (("training", training), ("test", test))
        if count
    )
    people = "".join(f'[[subject]]\ncode = "{code}"\n' for code in subjects)
    return (
        f'[study]\nname = "words"\nseed = 5\nconsent = "{consent}"\n'
        f'[recognition]\nparadigm = "{paradigm}"\nlead_s = 0.0\ngap_s = 0.05\nfeedback_s = 0.0\n'
        f"{extra}{items}{blocks}{people}"
    )


class Opened:
    def __init__(self, protocol, text, items, place, store, clock=None):
        self.task, self.store, self.clock = RecognitionTask.load(protocol, items, place), store, clock or Ticking()
        self.study = open_study(store, self.task, text, self.clock, token, beside=items)

    def presented(self, code="S1"):
        return open_session(self.study, code)

    def run(self, code, respondent):
        return run_session(self.presented(code), respondent)


def scripted_answer(text, block, number):
    trial = block_trials(parse_protocol(text, RecognitionProtocol), 0, block)[number]
    if number % 4 != 3:
        return trial.correct
    return trial.responses[(trial.responses.index(trial.correct) + 1) % len(trial.responses)]


@pytest.fixture(scope="module")
def controller():
    return design_controller(parse_display(tomllib.loads(DISPLAY)))


@pytest.fixture(scope="module")
def items(controller, tmp_path_factory):
    folder = tmp_path_factory.mktemp("items")
    write_items(controller, folder)
    return folder


@pytest.fixture
def opened(controller, items, tmp_path):
    with ExitStack() as now:

        def make(text):
            now.close()  # one program after the other
            rig = SimulatedRig(controller.display, 1)
            rig.load(controller)
            store = now.enter_context(opened_store(tmp_path / "lab.db"))
            protocol = parse_protocol(text, RecognitionProtocol)
            return Opened(protocol, text, items, Apparatus(rig, controller, "simulated"), store), rig, store

        yield make


THREE = ("M-index", "C-index", "L-index")


def answer(presented, response=None, watch=nobody):
    following = presented.present(watch)
    return presented.answer(records.Answer(response or following.trial.correct, presented.clock.utc()))


def go_on(presented, trials):
    session = presented
    steps = {"consent": session.give_consent, "break": session.end_break, "introduction": session.introduce}
    while trials and session.stage != "done":
        if session.stage == "trial":
            answer(presented)
            trials -= 1
        else:
            steps[session.stage]()


def opened_apparatus(made):
    rig = open_rig("simulated", made.display, 0)
    rig.load(made)
    return Apparatus(rig, made, "simulated")
