"""The console that the tests of its study share."""

import pytest

from tactuator.console.app import build_console
from tactuator.console.rig_process import RigProcess
from tactuator.console.state import ConsoleState
from tactuator.io.controller import write_controller
from tests.console.pages import TOKEN
from tests.web.server import served


@pytest.fixture(scope="module")
def console(controller, tmp_path_factory):
    """A console with a simulated rig in a process of its own, and the folder of its stores."""
    folder = tmp_path_factory.mktemp("console")
    state, host = ConsoleState(folder=folder), RigProcess("simulated", controller.display, 2)
    try:
        with served(build_console(state, TOKEN, rig=host)) as client:
            client.host, client.state, client.folder = host, state, folder
            client.file = folder / "controller.json"
            write_controller(client.file, controller)
            yield client
    finally:
        host.close()
