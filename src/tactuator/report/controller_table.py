"""The tables of a controller as texts: its figures, and the findings of its verdict, to the digits that are printed."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any

from tactuator.model.controller import ChannelController
from tactuator.model.verdict import Finding

FINDING_COLUMNS = ("objective", "channel", "outcome", "found", "allowed", "frequency", "load")
_ROWS: Mapping[str, tuple[str, ...]] = {
    "crossover (Hz)": ("margins", "crossover_hz"),
    "phase margin (deg)": ("margins", "phase_margin_deg"),
    "gain margin (dB)": ("margins", "gain_margin_db"),
    "max|S|": ("margins", "sensitivity_peak"),
    "max|T|": ("margins", "complementary_peak"),
    "disk margin": ("margins", "disk_margin"),
    "delay margin (samples)": ("margins", "delay_margin_samples"),
    "command noise gain": ("margins", "command_noise_gain"),
    "mean |S| over the rejection band (dB)": ("rejection_db", "mean"),
    "prefilter: poles": ("prefilter", "poles"),
    "prefilter: greatest error (dB)": ("prefilter", "max_error_db"),
    "prefilter: rms error (dB)": ("prefilter", "rms_error_db"),
}


def design_rows(channels: Sequence[ChannelController]) -> Iterator[tuple[str, ...]]:
    """Yield the figures of a design, the worst over the loads: their name, then a cell for each channel."""
    for words, keys in _ROWS.items():
        yield words, *(_cell(_found(one.report, keys)) for one in channels)
    lines_hz = sorted({key for one in channels for key in one.report.get("mains_db", {})}, key=float)
    for key in lines_hz:
        yield f"|T| at {key} Hz (dB)", *(_cell(_found(one.report, ("mains_db", key))) for one in channels)


def finding_row(one: Finding) -> tuple[str, ...]:
    """Return a finding as the cells of `FINDING_COLUMNS`."""
    unit = f" {one.unit}" if one.unit else ""
    found = one.quantity if one.value is None else f"{one.quantity} {one.value:.2f}{unit}"
    allowed = "" if one.allowed is None else f"{one.allowed:g}{unit}"
    at = "" if one.frequency_hz is None else f"{one.frequency_hz:.4g} Hz"
    return one.objective, one.channel, one.outcome.value, found, allowed, at, one.load


def remark_lines(findings: Iterable[Finding]) -> list[str]:
    """Return the findings' remarks, one line each; channels, and objectives, of which the same is said share a line."""
    channels: dict[tuple[str, str], dict[str, None]] = {}
    for one in findings:
        if one.remark:
            channels.setdefault((one.objective, one.remark), {})[one.channel] = None
    objectives: dict[tuple[str, str], list[str]] = {}
    for (objective, remark), names in channels.items():
        objectives.setdefault((", ".join(names), remark), []).append(objective)
    return [f"{', '.join(one)}, {names}: {remark}" for (names, remark), one in objectives.items()]


def _found(report: Any, keys: tuple[str, ...]) -> Any:
    for key in keys:
        report = report.get(key) if report is not None else None
    return report


def _cell(value: Any) -> str:
    if value is None:
        return "—"
    return f"{value:.2f}" if isinstance(value, float) else str(value)
