"""What differs between two tables of what the commands gave, told so that one can read it."""

# ruff: noqa: T201

from __future__ import annotations

import difflib
import json
import re
from collections import defaultdict
from collections.abc import Iterator
from typing import Any

from tests.golden.reduced import Flat

NUMBER = re.compile(r"(?<![\w.])[-−+]?\d+(?:\.\d+)?(?:e[-+]?\d+)?(?![\w])")
AT_MOST, LONG = 12, 150


def apart(old: Any, new: Any, scale: float = 0.0) -> float:
    """How far two numbers are apart, as a share of the greater (or of a scale)."""
    return abs(old - new) / max(abs(old), abs(new), scale, 1e-9)


def is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def short(value: Any) -> str:
    text = json.dumps(value, ensure_ascii=False)
    return text if len(text) <= LONG else text[: LONG - 1] + "…"


def told_lines(old: list[Any], new: list[Any], within: float) -> Iterator[str]:
    """What differs between lines of text, numbers aside that are the same within the tolerance."""
    skeletons = [[NUMBER.sub("#", str(line)) for line in text] for text in (old, new)]
    for kind, a, b, c, d in difflib.SequenceMatcher(None, *skeletons, autojunk=False).get_opcodes():
        if kind == "equal":
            for one, other in zip(old[a:b], new[c:d], strict=True):
                pairs = zip(
                    *(map(float, (n.replace("−", "-") for n in NUMBER.findall(str(line)))) for line in (one, other)),
                    strict=True,
                )
                if any(apart(*pair) > within for pair in pairs):
                    yield f"~ {one}  ->  {other}"
        else:
            yield from (f"- {line}" for line in old[a:b])
            yield from (f"+ {line}" for line in new[c:d])


def told(old: Any, new: Any, within: float) -> Iterator[str]:
    """What differs between two values of one key; nothing where they are the same."""
    if is_number(old) and is_number(new):
        if apart(old, new) > within:
            yield f"~ {old!r} -> {new!r} ({100.0 * apart(old, new):.2g} %)"
    elif isinstance(old, dict) and isinstance(new, dict) and "rms" in old and "rms" in new:
        scale, pairs = 1e-3 * max(abs(old["rms"]), abs(new["rms"])), []
        for key in ("mean", "rms", "least", "greatest"):
            pairs.append((old[key], new[key]))
        pairs += zip(old["at"], new["at"], strict=True) if len(old["at"]) == len(new["at"]) else []
        most = max(apart(*pair, scale) for pair in pairs)
        if most > within or any(old.get(key) != new.get(key) for key in ("of", "empty")):
            rms = f"rms {old['rms']} of {old['of']} values -> {new['rms']} of {new['of']}"
            yield f"~ {rms} (at most {100.0 * most:.2g} % apart)"
    elif isinstance(old, list) and isinstance(new, list):
        if len(old) == len(new) and all(map(is_number, [*old, *new])):
            if any(apart(*pair) > within for pair in zip(old, new, strict=True)):
                yield f"~ {short(old)} -> {short(new)}"
        else:
            yield from told_lines(old, new, within)
    elif old != new:
        yield f"~ {short(old)} -> {short(new)}"


def differences(old: dict[str, Flat], new: dict[str, Flat], within: float) -> Iterator[tuple[str, str, str]]:
    """Command, key and what differs, in the order of the commands."""
    for name in dict.fromkeys([*old, *new]):
        if name not in new or name not in old:
            yield name, "", "- command is gone" if name in old else "+ command is new"
            continue
        for key in dict.fromkeys([*old[name], *new[name]]):
            if key not in new[name]:
                yield name, key, f"- {short(old[name][key])}"
            elif key not in old[name]:
                yield name, key, f"+ {short(new[name][key])}"
            else:
                yield from ((name, key, line) for line in told(old[name][key], new[name][key], within))


def share(line: str) -> float:
    """How far apart a line says two numbers are, per cent."""
    found = re.search(r"\((?:at most )?([\d.e+-]+) %", line)
    return float(found[1]) if found else 0.0


def report(rows: list[tuple[str, str, str]], whole: bool) -> None:
    """Print what differs: what is in three commands or more once, then the rest of each."""

    def alike(key: str, line: str) -> tuple[str, str]:
        place = re.sub(r"\[[^\]]*\]", "[]", re.sub(r"^[^:]*(\.\w+):", r"*\1:", key))
        return place, line if line[0] == "~" and not NUMBER.search(line) else line[0]

    where: dict[tuple[str, str], list[str]] = defaultdict(list)
    for name, key, line in rows:
        where[alike(key, line)] += [name] if name not in where[alike(key, line)] else []
    often = {
        place: names
        for place, names in where.items()
        if len(names) >= 3 and not whole and "text" not in place[0] and " " not in place[0]
    }
    for (key, line), names in often.items():
        most = max((share(told_of) for _, own, told_of in rows if alike(own, told_of) == (key, line)), default=0.0)
        by = f" (at most {most:.2g} %)" if line == "~" and most else ""
        print(f"{line} {key}{by}  in {len(names)} commands: {', '.join(names[:AT_MOST])}")
    of: dict[str, list[str]] = defaultdict(list)
    for name, key, line in rows:
        if alike(key, line) not in often:
            of[name].append(f"  {line[0]} {key}: {line[2:]}")
    for name, told_of in of.items():
        print(name)
        print(*(told_of if whole else told_of[: 3 * AT_MOST]), sep="\n")
        if len(told_of) > 3 * AT_MOST and not whole:
            print(f"  and {len(told_of) - 3 * AT_MOST} more (--all)")
