"""The chain's verbs that play something, or take a person's answers. Examples run in the folder of `tt.examples()`."""

from __future__ import annotations

from pathlib import Path

from numpy.typing import ArrayLike

from tactuator.api.chain import Place
from tactuator.api.measured import (
    FeltLevels,
    MeasuredResponses,
    PaperResult,
    PlayedResult,
    SpokenResult,
    StoreThresholds,
)
from tactuator.api.result import promoted
from tactuator.experiment.result import thresholds as threshold_runs
from tactuator.experiment.store.store import Store
from tactuator.experiment.store.stored_runs import detection_runs
from tactuator.io.atomic import atomic_folder
from tactuator.io.reference import open_reference
from tactuator.measure.noise import felt_noise
from tactuator.measure.options import LISTENED_S, MAINS_HZ, MeasurementOptions
from tactuator.measure.stepped_sine import stepped_sine
from tactuator.model.controller import Controller
from tactuator.paper.plan import Plan, paper_display
from tactuator.paper.publication.comparison import comparison
from tactuator.paper.publication.publish import OWN_NAMES, publish
from tactuator.paper.publication.summary import summary
from tactuator.paper.run import run_study
from tactuator.paper.speech import check_speech
from tactuator.rig.finger import touch_all
from tactuator.rig.player import play_reference
from tactuator.rig.rig import Rig
from tactuator.speech.coding import coding_of
from tactuator.speech.options import CODING, LEVEL_DB_SL
from tactuator.speech.render import RenderJob, render_file


def measure_response(
    rig: Rig,
    controller: Controller,
    frequency_hz: ArrayLike,
    level_db_sl: float = MeasurementOptions.level_db_sl,
    load: str = "none",
    mains_hz: float | None = MAINS_HZ,
) -> MeasuredResponses:
    """Load the controller and measure the response by stepped sine at frequencies (m,), a level and a load.

    Frequencies keep 2 Hz off multiples of mains_hz (None: there are none). Raises BadInput for another load or level.

    >>> tt.measure_response(rig, controller, [10.0, 100.0]).to_dict()["frequency_hz"][:2]
    [10.0, 100.0]
    """
    touch_all(rig, controller.display.channels, load)
    rig.load(controller)
    options = MeasurementOptions(
        level_db_sl, load=load, mains_hz=mains_hz or 0.0, controller_hash=controller.content_hash
    )
    return MeasuredResponses(stepped_sine(rig, frequency_hz, options), controller.display)


def noise(rig: Rig, controller: Controller, duration_s: float = LISTENED_S, load: str = "none") -> FeltLevels:
    """Load the controller, hold the display at rest and return what a resting finger would feel of hum and noise.

    >>> sorted(tt.noise(rig, controller, duration_s=4.0).headline())
    ['index', 'middle', 'thumb']
    """
    touch_all(rig, controller.display.channels, load)
    rig.load(controller)
    return FeltLevels(tuple(felt_noise(rig, controller.display, duration_s=duration_s, load=load)))


def render(
    speech: Place, controller: Controller, out: Place, coding: str = CODING, level_db_sl: float = LEVEL_DB_SL
) -> SpokenResult:
    """Code a speech file onto the fingers at a level, and write the reference (.wav with its .json, or .h5).

    >>> tt.render("speech.wav", controller, "reference.wav").path.name
    'reference.wav'
    """
    job = RenderJob(controller, coding_of(coding), level_db_sl)
    return SpokenResult(Path(out), render_file(Path(speech), Path(out), job).document())


def play(rig: Rig, controller: Controller, reference: Place) -> PlayedResult:
    """Load the controller and play a reference that `render` wrote; the rig is at rest afterwards.

    >>> tt.play(rig, controller, "protocols/a.wav")
    <Played length: 0.50 s, played: 0.50 s, saturated: 0.00 s>
    """
    rig.load(controller)
    return promoted(PlayedResult, play_reference(rig, open_reference(Path(reference))))


def thresholds(store: Place) -> StoreThresholds:
    """Refit the thresholds of every finished run of an experiment's store.

    >>> tt.thresholds("lab.db").headline()["subjects"]
    '1'
    """
    database = Store(Path(store), must_exist=True)
    try:
        runs = detection_runs(database)
    finally:
        database.close()
    return StoreThresholds(tuple(threshold_runs.thresholds(runs)))


def reproduce(folder: Place = "out/paper", speech: Place | None = None, seed: int = 1) -> PaperResult:
    """Run the paper's study on the simulated display (minutes) and write report, figures and summary into `folder`.

    >>> tt.reproduce("paper", speech="nothing.wav")
    Traceback (most recent call last):
    ...
    tactuator.errors.BadInput: nothing.wav: no such file; allowed: a sound file
    """
    plan = Plan(paper_display(), seed, None if speech is None else Path(speech))
    file = check_speech(plan)
    with atomic_folder(folder, OWN_NAMES) as beside:
        study = run_study(plan, file, lambda step, done: None)
        publish(study, beside)
    rows = tuple((row.what, row.paper, row.here) for row in comparison(study))
    return PaperResult(Path(folder), summary(study), rows)
