"""The pages in a real Chromium: a whole session by keyboard, a phone, two tabs, and a server that dies."""

import random

import pytest
from sqlalchemy import select

from tactuator.experiment import schema
from tactuator.experiment.protocol_file import parse_protocol
from tactuator.experiment.store import Store
from tactuator.experiment.stored_runs import detection_runs
from tactuator.experiment.thresholds import thresholds
from tactuator.experiment.trial import ForcedChoice
from tactuator.files.controller import write_controller
from tests.experiment.stations import PROTOCOL, ObedientClock, answer_one, begin, controller
from tests.web.study import Server, Subject, browser, finish, visible, watch_errors  # noqa: F401

ONE = PROTOCOL[: PROTOCOL.rindex("[[subject]]")]


@pytest.fixture
def server(tmp_path):
    (tmp_path / "protocol.toml").write_text(ONE)
    write_controller(tmp_path / "controller.json", controller())
    made = Server(tmp_path / "protocol.toml", tmp_path / "lab.db", tmp_path / "controller.json")
    made.start()
    yield made
    made.kill()


def outcome(path):
    """Every stored trial, and the thresholds as commanded."""
    store = Store(path)
    query = (
        select(schema.run.c.position, schema.trial.c.number, schema.trial.c.level_db_sl, schema.response.c.response)
        .select_from(schema.run.join(schema.trial).join(schema.response))
        .order_by(schema.trial.c.id)
    )
    with store.read() as connection:
        rows = [tuple(row) for row in connection.execute(query)]
    found = [(one.frequency_hz, one.own_db_sl, one.refit_db_sl, one.refit_sd_db) for one in thresholds(detection_runs(store))]
    store.close()
    return rows, found


def undisturbed(path):
    clock, store = ObedientClock(), Store(path)
    conduct = begin(store, clock, ONE)
    while conduct.session.stage != "done":
        if conduct.session.stage == "break":
            conduct.session.end_break()
        answer_one(conduct, clock)
    store.close()
    return outcome(path)


def kills_and_finish(server, subject, kills: int, seed: int) -> None:
    """Kill the server at random moments of the session and start it again, until `kills` are done; then finish."""
    rng = random.Random(seed)
    for _ in range(kills):
        for _ in range(rng.randrange(1, 12)):
            if not subject.act():
                return
        subject.page.wait_for_timeout(rng.uniform(0.0, 60.0))
        server.kill()
        server.start()
    finish(subject, 120.0)


def test_session__answered_by_keyboard_with_the_server_killed__is_the_undisturbed_one(server, browser, tmp_path) -> None:  # noqa: F811
    page = browser.new_page()
    errors = watch_errors(page)
    page.goto(server.addresses["subject S1"])
    subject = Subject(page, server.protocol)
    page.reload()
    visible(page, "Before we begin")
    kills_and_finish(server, subject, 3, seed=1)
    assert errors == []
    rows, found = outcome(server.store)
    assert (rows, found) == undisturbed(tmp_path / "whole.db")
    assert len({row[:2] for row in rows}) == len(rows)
    assert {(run - 1, number) for run, number in subject.acknowledged} <= {row[:2] for row in rows}
    page.close()


@pytest.mark.soak
def test_session__server_killed_fifty_times__is_the_undisturbed_one(tmp_path, browser) -> None:  # noqa: F811
    text = ONE.replace("reversals = 6", "reversals = 24").replace("averaged = 4", "averaged = 20")
    (tmp_path / "protocol.toml").write_text(text)
    write_controller(tmp_path / "controller.json", controller())
    server = Server(tmp_path / "protocol.toml", tmp_path / "lab.db", tmp_path / "controller.json")
    server.start()
    page = browser.new_page()
    page.goto(server.addresses["subject S1"])
    subject = Subject(page, server.protocol)
    kills_and_finish(server, subject, 50, seed=2)
    server.kill()
    rows, found = outcome(server.store)
    clock, store = ObedientClock(), Store(tmp_path / "whole.db")
    conduct = begin(store, clock, text)
    while conduct.session.stage != "done":
        if conduct.session.stage == "break":
            conduct.session.end_break()
        answer_one(conduct, clock)
    store.close()
    assert (rows, found) == outcome(tmp_path / "whole.db")
    assert len({row[:2] for row in rows}) == len(rows)
    assert {(run - 1, number) for run, number in subject.acknowledged} <= {row[:2] for row in rows}


def test_page__phone__fits_its_width_and_is_answered_by_touch(server, browser) -> None:  # noqa: F811
    context = browser.new_context(viewport={"width": 360, "height": 640}, has_touch=True)
    page = context.new_page()
    errors = watch_errors(page)
    page.goto(server.addresses["subject S1"])
    visible(page, "Before we begin")
    page.locator("#go").tap()
    visible(page, "Which interval has the vibration")
    page.locator("#go").tap()
    visible(page, "Which one")
    boxes = [button.bounding_box() for button in page.locator(".interval").all()]
    assert len(boxes) == len(ForcedChoice(parse_protocol(ONE).paradigm.intervals).responses)
    assert all(box is not None and box["x"] >= 0 and box["x"] + box["width"] <= 360 for box in boxes)
    assert all(box is not None and min(box["width"], box["height"]) >= 44 for box in boxes)
    page.locator(".interval").first.tap()
    page.wait_for_timeout(300)
    assert page.locator("body").get_attribute("data-trial") == "1/1"
    assert errors == []
    context.close()


def test_page__second_tab__takes_over_and_gives_back(server, browser) -> None:  # noqa: F811
    first, second = browser.new_page(), browser.new_page()
    first.goto(server.addresses["subject S1"])
    visible(first, "Before we begin")
    second.goto(server.addresses["subject S1"])
    visible(first, "opened in another tab")
    first.keyboard.press("Enter")
    visible(second, "opened in another tab")
    visible(first, "Before we begin")
    first.close()
    second.close()


def test_operator__page__shows_the_track_and_pauses(server, browser) -> None:  # noqa: F811
    operator, page = browser.new_page(), browser.new_page()
    errors = watch_errors(operator)
    operator.goto(server.addresses["operator"])
    page.goto(server.addresses["subject S1"])
    subject = Subject(page, server.protocol)
    while len(subject.acknowledged) < 8:
        subject.act()
    operator.locator("#track circle").nth(3).wait_for()
    assert "50 Hz" in operator.locator("#run").inner_text()
    operator.locator("[data-command=pause]").click()
    operator.locator("#state", has_text="paused").wait_for()
    stands = len(subject.acknowledged)
    for _ in range(20):
        subject.act()
    assert len(subject.acknowledged) <= stands + 1  # the trial that played was finished
    visible(page, "wait for the experimenter")
    operator.locator("[data-command=resume]").click()
    visible(page, "Which one")
    assert errors == []
    operator.close()
    page.close()
