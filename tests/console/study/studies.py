"""Pages at a study of the console, and what its store holds."""

import sqlite3
from contextlib import contextmanager

from tests.console.pages import TOKEN
from tests.console.scope.rig_page import Page
from tests.console.views.dropped import dropped
from tests.web.labs import begun, until


class Studies:
    """A page's connection to the study."""

    def __init__(self, socket):
        self.socket, self.study = socket, None
        socket.send_text(TOKEN)
        self.study = socket.receive_json()["study"]

    def ask(self, do, **more):
        self.socket.send_json({"id": 1, "do": do, **more})
        while "id" not in (message := self.socket.receive_json()):
            self.study = message["study"]
        return message


@contextmanager
def loaded(console):
    """A page of the scope that has loaded a controller and given the controls back."""
    page = Page(console)
    if page.standing["controls"] != "you":
        page.ask("take")
    page.ask("controller", source="file", file=dropped(console.workshop, console.file))
    page.until(lambda: page.standing["loaded"])
    page.ask("give")
    try:
        yield page
    finally:
        page.open.close()


def operator(socket):
    socket.send_text(TOKEN)
    return until(socket, "snapshot")


def link(console, code="S1"):
    with console.websocket_connect("/ws/operator") as socket:
        return next(one["link"] for one in operator(socket)["sessions"] if one["subject"] == code)


def answered(socket, trials):
    """Answer with "2", so many times."""
    for count in range(trials):
        asked = until(socket, "answer-now") if count else begun(socket)
        socket.send_json({"type": "answer", "run": asked["run"], "number": asked["number"], "response": "2"})
        until(socket, "ack")


def rows(path):
    query = "SELECT trial.number, level_db_sl, response FROM trial JOIN response ON response.trial_id = trial.id"
    connection = sqlite3.connect(f"file:{path}?mode=ro", uri=True)
    try:
        return connection.execute(query).fetchall()
    finally:
        connection.close()
