"""Coupled fingers from the record to the verdict, on a display of the witness's own (witnesses.coupling, a sample)."""

from pathlib import Path

import numpy as np
import pytest

import tactuator as tt
from tactuator.verbs.identified import CoupledModels
from witnesses.coupling import crosstalk, frame

LEVEL_DB, PERIOD_S, SEED = -20.0, 1.5, 1
"""A record of 27 s: six experiments of three periods."""


pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def chain(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, float, CoupledModels]:
    """A folder with record, models, coupling, display and controller; the frame's mass; what `identify` told."""
    folder, mass = tmp_path_factory.mktemp("coupled"), frame.mass_for(LEVEL_DB)
    frame.write_record(folder / "record.h5", mass, SEED, PERIOD_S, 6)
    told = tt.identify(folder / "record.h5", order=4, zeros=2, out=folder / "fingers.json")
    assert isinstance(told, CoupledModels)
    crosstalk.display_file(folder, coupled=True, loop="paper")
    tt.design(folder / "display.toml", out=folder / "controller.json")
    return folder, mass, told


def test_coupling__of_movers_on_a_frame__is_found(chain: tuple[Path, float, CoupledModels]) -> None:
    folder, mass, told = chain
    errors, inside = crosstalk.share_errors(folder, mass, [vars(pair) for pair in told.pairs])
    assert len(errors) == 6
    assert np.max(np.abs(errors)) < crosstalk.MOST_SHARE_DB
    assert inside > 0.85
    assert "dB" in told.coupling
    assert told.to_dict()["channels"].keys() == set(frame.NAMES)
    path = folder / "record.h5"
    for wrong in ({"from_s": 1.0}, {"validate": path}):
        with pytest.raises(tt.BadInput, match="several channels"):
            tt.identify(path, **wrong)  # type: ignore[arg-type]
    with pytest.raises(tt.BadInput, match="together"):
        tt.record(folder / "display.toml", together=True, channel="left")


def test_crosstalk__under_the_designed_controller__is_felt_as_the_verdict_says_or_missed_without_coupling(chain):
    folder, mass, _ = chain
    errors, outcome = crosstalk.felt_errors(folder, mass, SEED)
    assert len(errors) == 3
    assert np.max(np.abs(errors)) < crosstalk.MOST_FELT_DB
    assert outcome == "met"
    crosstalk.display_file(folder, coupled=False, loop="paper")
    assert crosstalk.felt_errors(folder, mass, SEED)[0] == [np.inf]
