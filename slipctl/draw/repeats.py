"""Equations that repeat: rows that differ in an index alone, values that wait for their turn."""

from __future__ import annotations

import re


def fold_repeats(rows: list[tuple[str, str]]) -> list[tuple[str, str]]:
    """Write equations that differ only in an index, one up from row to row, as one."""
    out: list[tuple[str, str]] = []
    at = 0
    while at < len(rows):
        first = _index(*rows[at])
        count = 1
        while first and at + count < len(rows) and _index(*rows[at + count], back=count) == first:
            count += 1
        if count < 3:
            out.append(rows[at])
            at += 1
            continue
        start = int(_INDEX.findall(rows[at][0])[0])

        def general(match: re.Match[str], start: int = start) -> str:
            shift = int(match[1]) - start
            return "[i]" if not shift else f"[i{shift:+d}]"

        left, right = (_INDEX.sub(general, side) for side in rows[at])
        out.append((left, f"{right}   for i = {start} .. {start + count - 1}"))
        at += count
    return out


def dead_time(rows: list[tuple[str, str]]) -> tuple[str, str, int] | None:
    """Output, input and ticks of a block that only waits: each value takes the place before it."""
    *shifts, (last, given), (out, oldest) = rows if len(rows) > 2 else [("", "")] * 3
    name, _, rest = last.partition("[")
    if not shifts or rest != f"{len(shifts)}]+" or oldest != f"{name}[0]":
        return None
    alike = all((left, right) == (f"{name}[{k}]+", f"{name}[{k + 1}]")
                for k, (left, right) in enumerate(shifts))  # fmt: skip
    return (out, given, len(shifts) + 1) if alike and not _INDEX.search(given) else None


def written_once(
    plain: list[tuple[str, str]], written: list[tuple[str, str]]
) -> list[tuple[str, str]]:
    """Leave out rows between the first and the last of many that differ in an index alone."""
    out: list[tuple[str, str]] = []
    at = 0
    while at < len(written):
        first, count = _index(*plain[at]), 1
        while first and at + count < len(plain) and _index(*plain[at + count], back=count) == first:
            count += 1
        if count < 4:
            out.append(written[at])
            at += 1
            continue
        out += [written[at], ("", f"and so on, {count} rows, up to"), written[at + count - 1]]
        at += count
    return out


_INDEX = re.compile(r"\[(\d+)\]")


def _index(left: str, right: str, back: int = 0) -> tuple[str, str] | None:
    """Both sides with every index ``back`` lower; None if the left side has none."""
    if not _INDEX.search(left):
        return None

    def lower(text: str) -> str:
        return _INDEX.sub(lambda m: f"[{int(m[1]) - back}]", text)

    return lower(left), lower(right)
