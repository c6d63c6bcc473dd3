"""A server that is killed again and again while the protocol is amended: no answer is lost, doubled or changed."""

import pytest

from tests.web.killing import LONG, ONE, kills_across_amendments


def test_session__server_killed_while_the_protocol_is_amended__is_the_undisturbed_one(tmp_path) -> None:
    answers, killing = kills_across_amendments(tmp_path, ONE, kills=4, every=2, seed=5)
    assert (answers > 30, killing.versions, killing.client.done) == (True, 3, True)


@pytest.mark.soak
def test_session__three_hundred_kills_across_amendments__loses_and_doubles_nothing(tmp_path) -> None:
    answers, killing = kills_across_amendments(tmp_path, LONG, kills=300, every=10, seed=6)
    assert answers > 600
    assert (killing.kills, killing.versions) == (300, 31)
