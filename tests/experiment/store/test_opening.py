"""A store in which a study is about to begin: kept once something is in it, taken away if it was made for nothing."""

import pytest

from tactuator.errors import BadInput
from tactuator.experiment.store.store import opened_store
from tests.experiment.session.apparatuses import ObedientClock, answer_one, begin, opened_study


def left(folder) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


@pytest.mark.parametrize("error", [KeyboardInterrupt, RuntimeError, BadInput("no"), None])
def test_opened_store__no_study_was_begun__is_taken_away(tmp_path, error) -> None:
    def leave() -> None:
        with opened_store(tmp_path / "lab.db"):
            if error is not None:
                raise error

    if error is None:
        leave()
    else:
        with pytest.raises(type(error) if isinstance(error, BadInput) else error):
            leave()
    assert left(tmp_path) == []


def test_opened_store__interrupted_before_anybody_came__keeps_the_study_whose_links_are_given_out(tmp_path) -> None:
    with pytest.raises(KeyboardInterrupt), opened_store(tmp_path / "lab.db") as store:
        opened_study(store, ObedientClock())
        raise KeyboardInterrupt
    assert left(tmp_path) == ["lab.db"]


def test_opened_store__refused_after_an_answer__keeps_it(tmp_path) -> None:
    clock = ObedientClock()
    with pytest.raises(BadInput), opened_store(tmp_path / "lab.db") as store:
        answer_one(begin(store, clock), clock)
        raise BadInput("no")
    assert left(tmp_path) == ["lab.db"]


def test_opened_store__was_there_before__is_left_as_it_is(tmp_path) -> None:
    (tmp_path / "lab.db").touch()
    with pytest.raises(BadInput), opened_store(tmp_path / "lab.db") as store:
        opened_study(store, ObedientClock())
        raise BadInput("no")
    assert left(tmp_path) == ["lab.db"]
