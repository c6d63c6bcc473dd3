"""The console that the tests of the scope share."""

import pytest

from tactuator.console.app import build_console
from tactuator.console.scope.host import RigHost
from tactuator.console.workshop import Workshop
from tactuator.io.controller import write_controller
from tests.console.pages import TOKEN
from tests.web.server import served


@pytest.fixture(scope="module")
def console(controller, tmp_path_factory):
    """A console with a simulated rig in a process of its own, live."""
    host = RigHost("simulated", controller.display, 2)
    try:
        with served(build_console(Workshop(), TOKEN, rig=host)) as client:
            client.host, client.file = host, tmp_path_factory.mktemp("console") / "controller.json"
            write_controller(client.file, controller)
            yield client
    finally:
        host.close()
