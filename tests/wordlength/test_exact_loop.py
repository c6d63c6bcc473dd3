"""The exact loop, run at once, is the stepped loop; where a command comes to its limit it is that loop itself."""

from dataclasses import replace

import numpy as np
import pytest

from tactuator.runtime.coefficients import delta_coefficients
from tactuator.wordlength import roundoff as module
from tactuator.wordlength.roundoff import double_step, exact_loop, roundoff_reference, run_loop
from tests.runtime.paper_display import channel, controller, display


@pytest.mark.parametrize("rate_hz", [4000.0, 16_000.0])
@pytest.mark.parametrize(("delay_samples", "delay_s"), [(1, 0.0), (2, 0.00065), (0, 0.0)])
@pytest.mark.parametrize("fed_back", [True, False])
def test_exact_loop__within_the_limit__is_the_stepped_loop(
    rate_hz: float, delay_samples: int, delay_s: float, fed_back: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    late = replace(channel(), plant=replace(channel().plant, delay_s=delay_s))
    of = display(late, delay_samples=delay_samples, rate_hz=rate_hz)
    own = controller(display(late, delay_samples=1, rate_hz=rate_hz)).channels[0]
    assert own.feedback_sos is not None
    rows = delta_coefficients(own.prefilter_sos), delta_coefficients(own.feedback_sos) if fed_back else None
    reference, _, _ = roundoff_reference(rate_hz, 30.0)
    reference = reference[::4]
    stepped = run_loop(late, of, double_step(*rows, 1e9), reference)
    monkeypatch.setattr(module, "run_loop", None)  # it is run at once
    found = exact_loop(late, of, *rows, 1e9, reference)
    np.testing.assert_allclose(found, stepped, rtol=0.0, atol=1e-9 * float(np.max(np.abs(stepped))))


def test_exact_loop__command_at_its_limit__is_stepped() -> None:
    of = display(channel())
    own = controller(of).channels[0]
    assert own.feedback_sos is not None
    rows = delta_coefficients(own.prefilter_sos), delta_coefficients(own.feedback_sos)
    reference = np.full(400, 300.0)
    free, held = (exact_loop(of.channels[0], of, *rows, most, reference) for most in (1e9, 0.5))
    np.testing.assert_array_equal(held, run_loop(of.channels[0], of, double_step(*rows, 0.5), reference))
    assert np.max(np.abs(free - held)) > 0.01
