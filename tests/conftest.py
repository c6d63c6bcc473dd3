"""What holds for every test."""

import os
import signal

import pytest
from hypothesis import HealthCheck, settings

from tactuator.display.controller import Controller
from tests.three_fingers import three_finger_display

# A test says nothing about wall-clock time, and the same tree gives the same outcome; the soak looks further.
settings.register_profile("test", deadline=None, derandomize=True, suppress_health_check=[HealthCheck.too_slow])
settings.register_profile("soak", deadline=None, max_examples=20_000, suppress_health_check=[HealthCheck.too_slow])
settings.load_profile(os.environ.get("HYPOTHESIS_PROFILE", "test"))

# A shell starts what runs in the background with SIGINT ignored; the programs under test would inherit that.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)


@pytest.fixture(scope="session")
def controller() -> Controller:
    """A controller designed for a display with three fingers, once for all tests that play references."""
    from tactuator.files.display import parse_display
    from tactuator.synthesis.design import design_controller

    return design_controller(parse_display(three_finger_display()))
