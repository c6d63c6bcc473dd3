"""Escape in each state of the subject's page: nothing is felt any more until the subject goes on. How long it takes is
told by `witnesses.stop.escape`, since a time on a machine that does other work tells nothing.
"""

import pytest

from witnesses.stop.escape import STATES, WATCHED_MS, escaped, subject_page

SOON_MS = 0.2 * WATCHED_MS  # far less than an interval and its gap


MARKS = {
    **dict.fromkeys(("going on", "interval 2", "feedback", "after a pause"), ()),
    **dict.fromkeys(("interval 1", "interval 3"), pytest.mark.soak),  # as interval 2, but for the lamp
}


@pytest.mark.parametrize("state", [pytest.param(state, marks=MARKS.get(state, pytest.mark.slow)) for state in STATES])
def test_escape__in_each_state__is_silence_until_the_subject_goes_on(browser, tmp_path, state) -> None:
    with subject_page(browser, tmp_path) as (page, felt):
        lasts_ms, stage, masked = escaped(page, felt, state)
    assert lasts_ms < SOON_MS
    assert stage == ("stopped" if state == "stopped for today" else "paused")
    assert not masked  # the rig is at rest by then
