"""What was felt, from the truth: displacement through the exact inverse of the designed H, by transforms alone.

The guard sees y through a filter of four poles that was fitted to the threshold voltage; here H = F T is computed from
the controller's sections and the plant under a zero-order hold, and divided by, so the one can be held to the other.
Above 300 Hz the inverse would amplify what little the noise moves: a kernel of three positive taps (1, 2, 1)/4, which
cannot make a peak greater, takes it off (0.5 dB of 300 Hz as well).
"""

import numpy as np
from numpy.typing import NDArray
from scipy import signal

from tactuator.model.controller import Controller

SIZE, TAIL = 1 << 15, 8000
Samples = NDArray[np.float64]


class FeltReference:
    def __init__(self, controller: Controller, channel: int) -> None:
        self._controller, self._channel = controller, channel
        self._frequency_hz = np.fft.rfftfreq(SIZE, 1.0 / controller.rate_hz)
        self._frequency_hz[0] = 1e-9  # the feedback controller's pole at 0
        self._designed = self.response(None)
        self._kernel = np.cos(np.pi * self._frequency_hz / controller.rate_hz) ** 2  # (1, 2, 1)/4 about its middle

    @property
    def inverse(self) -> NDArray[np.complex128]:
        """Of y's transform: what makes the felt reference of it."""
        return np.asarray(self._kernel / self._designed)

    def response(self, load: str | None) -> NDArray[np.complex128]:
        """H at the transform's frequencies, under a load of the display file or none."""
        described = self._controller.display.channels[self._channel]
        made, rate = self._controller.channels[self._channel], self._controller.rate_hz
        plant = described.loaded_plant(next((each for each in described.loads if each.name == load), None))
        fraction = signal.zpk2tf(plant.zeros, plant.poles, plant.gain)
        numerator, denominator, _ = signal.cont2discrete(fraction, 1.0 / rate, "zoh")
        angle = 2.0 * np.pi * self._frequency_hz / rate
        held = signal.freqz(numerator.ravel(), denominator, angle)[1]
        delay = np.exp(-1j * angle * self._controller.delay_samples)
        forward = signal.sosfreqz(made.feedback_sos, angle)[1] * held * delay
        return np.asarray(signal.sosfreqz(made.prefilter_sos, angle)[1] * forward / (1.0 + forward))

    def of(self, displacement_mm: Samples) -> Samples:
        """Threshold units, from displacement (n,), which begins at rest; its last samples are not judged."""
        position_v = self._controller.display.channels[self._channel].sensor_gain_v_per_mm * displacement_mm
        fade = position_v[-1] * (0.5 + 0.5 * np.cos(np.pi * np.arange(TAIL) / TAIL))
        spectrum = np.fft.rfft(np.concatenate([position_v, fade]), SIZE) * self.inverse
        return np.asarray(np.fft.irfft(spectrum, SIZE)[: len(displacement_mm) - 6])

    def worst_reference(self, load: str) -> Samples:
        """Signs (n,) that drive a loaded channel's felt reference as far as anything within +/- 1 can."""
        kernel = np.fft.irfft(self.response(load) / self._designed * self._kernel, SIZE)
        return np.where(kernel[:1500][::-1] < 0.0, -1.0, 1.0)
