"""What tests of experiments begin with: a store that is empty, and a clock that obeys."""

import pytest

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
