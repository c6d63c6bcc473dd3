"""The console that the tests of its study share."""

import pytest

from tactuator.console.state import ConsoleState
from tactuator.io.controller import write_controller
from tests.console.pages import console_with


@pytest.fixture(scope="module")
def console(controller, tmp_path_factory):
    folder = tmp_path_factory.mktemp("console")
    with console_with(ConsoleState(folder=folder), "simulated", controller.display, 2) as client:
        client.file = folder / "controller.json"
        write_controller(client.file, controller)
        yield client
