"""What tests of experiments begin with: a store that is empty, and a clock that obeys."""

import pytest
from scipy.special import expit, logit

from tactuator.experiment.store.store import Store
from tests.experiment.session.apparatuses import ObedientClock


@pytest.fixture
def store(tmp_path):
    made = Store(tmp_path / "lab.db")
    yield made
    made.close()


@pytest.fixture
def clock():
    return ObedientClock()


class Logistic:
    """People whose psychometric function is logistic, by 0.5 a dB: the program believes in a Weibull."""

    def rise(self, level_db, at_threshold):
        return expit(0.5 * level_db + logit(at_threshold))
