"""Messages that nobody means, from a mutator that knows the kinds of messages but not the server's checks."""

from __future__ import annotations

import copy
import itertools
import json
import logging
from collections.abc import Callable
from contextlib import ExitStack, suppress
from importlib import import_module
from typing import Any

import numpy as np
import pytest
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect

LOGGERS = ("uvicorn", "uvicorn.error", "uvicorn.access", "asyncio", "tactuator.web.lab")
"""Where a server's defects are told."""
NASTY = (
    *(2**63, -(2**63), 2**200, -1, 0, 0.5, 1e308, float("nan"), float("inf"), -float("inf"), True, False, None, ""),
    *(" ", "1", "x" * 300, "\u0000", "\u202e", "\ud800", "=1+1", "'; DROP TABLE trial;--", "S1", "trial", "withdraw"),
    *([], {}, [[[[]]]], {"a": {"b": []}}, [None] * 20, ["1"], {"type": "answer"}),
)
RAW = ("9" * 5000, "1e400", "-0", "[" * 3000, "NaN", '"\\ud800"', '"\\u0000"', "1e-400", "0x10", "[[[[1]]]]")
"""Values as they stand in a text, those among them that no JSON writer would write."""


def hear_all(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let a test hear all that a server logs: uvicorn's own loggers do not pass on."""
    for name in LOGGERS:
        monkeypatch.setattr(logging.getLogger(name), "propagate", True)


def defects(caplog: pytest.LogCaptureFixture) -> list[str]:
    return [record.getMessage() for record in caplog.records if record.levelno >= logging.ERROR]


def fails_once(monkeypatch: pytest.MonkeyPatch, name: str, at: int) -> None:
    """Put a defect into a function: its call of that number divides by zero."""
    room, _, function = name.rpartition(".")
    whole, calls = getattr(import_module(room), function), itertools.count()
    monkeypatch.setattr(name, lambda *given: 1 / 0 if next(calls) == at else whole(*given))


def mutated(rng: np.random.Generator, message: dict) -> str | bytes:
    """A message changed somewhere: a value, a key, the text, the bytes; now and then it is left as it is."""
    made, kind = copy.deepcopy(message), int(rng.integers(9))
    place = made
    while isinstance(inner := place[key := _key(rng, place)], dict | list) and inner and rng.random() < 0.7:
        place = inner
    place = place if isinstance(place, dict) else made
    key = key if key in place else next(iter(place))
    nasty = NASTY[int(rng.integers(len(NASTY)))]
    if kind == 0:
        return json.dumps(made)
    if kind in (1, 2):
        place[key] = nasty
    elif kind == 3:
        del place[key]
    elif kind == 4:
        place[f"{nasty}"[:40]] = NASTY[int(rng.integers(len(NASTY)))]
    elif kind == 8:
        place[key] = "@"
        return json.dumps(made).replace('"@"', RAW[int(rng.integers(len(RAW)))])
    text = json.dumps(made)
    if kind == 5:
        at = int(rng.integers(len(text)))
        text = text[:at] + str(nasty)[:50].encode("utf-8", "replace").decode() + text[at + int(rng.integers(4)) :]
    elif kind == 6:
        text = text[: int(rng.integers(len(text)))]
    elif kind == 7:
        return bytes(rng.integers(0, 256, int(rng.integers(64)), dtype=np.uint8))
    return text.encode("utf-8", "replace").decode()


def _key(rng: np.random.Generator, place: Any) -> Any:
    keys = list(place) if isinstance(place, dict) else range(len(place))
    return keys[int(rng.integers(len(keys)))]


class Asking:
    """One connection, whose answers are read up to that to a message which no other is like."""

    def __init__(self, port: int, path: str, first: str | None, last: dict[str, Any], word: str) -> None:
        self._open, self._last, self._word = ExitStack(), json.dumps(last), word
        self.socket = self._open.enter_context(connect(f"ws://127.0.0.1:{port}{path}"))
        if first is not None:
            self.socket.send(first)

    def settle(self) -> list[str]:
        """Send the last message, and return all that was said until it was answered, as text."""
        self.socket.send(self._last)
        heard = [""]
        while self._word not in heard[-1]:
            if isinstance(text := self.socket.recv(timeout=60.0), str):
                heard.append(text)
                json.loads(text, parse_constant=_no_number)
        return heard[1:]

    def close(self) -> None:
        with suppress(ConnectionClosed):
            self._open.close()


def _no_number(name: str) -> None:
    raise AssertionError(f"{name} was sent, which no page can read")


def fuzz(
    opened: Callable[[], Asking],
    messages: list[dict[str, Any]],
    count: int,
    told: tuple[pytest.LogCaptureFixture, pytest.MonkeyPatch],
    goes_on: Callable[[], object],
    kept: float = 1.0,
) -> list[str]:
    """Send so many altered messages, and return the answers; fails where a defect is logged or answered.

    goes_on: called now and then, that another connection finds the server as it was. kept: share of the unaltered
    messages that are sent.
    """
    hear_all(told[1])
    rng, heard, asking = np.random.default_rng(21), [], opened()
    for index in range(count):
        message = messages[int(rng.integers(len(messages)))]
        while (text := mutated(rng, message)) == json.dumps(message) and rng.random() > kept:
            pass
        try:
            asking.socket.send(text)
            if index % 20 == 19:
                heard += asking.settle()
        except ConnectionClosed:
            asking.close()
            asking = opened()
        if index % 500 == 499 or index == count - 1:
            goes_on()
    asking.close()
    assert not (amiss := defects(told[0]) + [text for text in heard if "a defect of" in text]), amiss[0]
    return heard
