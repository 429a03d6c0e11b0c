"""The commands certify and check: numbers as a person writes them, answers as a table or JSON."""

from __future__ import annotations

import re
from collections.abc import Sequence
from fractions import Fraction
from pathlib import Path

from slipctl import __version__, store
from slipctl.certify import certificate
from slipctl.certify.super_twisting import UNITS
from slipctl.certify.twisting_report import Report, super_twisting_report
from slipctl.errors import BadInput, RunFailed, nearest

SYSTEMS = ("super_twisting",)
NUMBER = re.compile(r"[+-]?(\d{1,60}(\.\d{0,60})?|\.\d{1,60})([eE][+-]?\d{1,2})?|\d{1,60}/\d{1,60}")


def certify(
    system: str, settings: Sequence[str], as_json: bool, out: str | None, command: str
) -> str:
    """Answer of ``slipctl certify``; writes a certificate to ``out``.

    Raises:
        BadInput: an unknown system or name, or a number that means nothing.
    """
    if system not in SYSTEMS:
        raise BadInput(f"cannot certify {system!r}{nearest(system, SYSTEMS)}")
    gains = read_gains(settings)
    report = super_twisting_report(**gains)
    if out is not None:
        path = Path(out)
        if path.is_dir():
            raise BadInput(f"{path} is a folder; write a file, {path / 'certificate.json'}")
        store.check_folder(path.parent)
        payload = certificate.certify_super_twisting(**gains).payload()
        store.write_json(path, payload)
    if as_json:
        said = {"format": store.FORMAT, **report.payload()}
        return store.json_text(said | {"slipctl": __version__, "command": command}).rstrip()
    written = f"\n\n{out}: certificate; slipctl check {out}" if out is not None else ""
    return table(report) + written


def read_gains(settings: Sequence[str]) -> dict[str, Fraction]:
    """Numbers of ``k1=1.5`` as exact rationals.

    Raises:
        BadInput: an unknown, repeated or missing name, or no number.
    """
    found: dict[str, Fraction] = {}
    for text in settings:
        name, equals, value = text.partition("=")
        if not equals:
            raise BadInput(f"--set {text}: write NAME=VALUE, k1=1.5")
        if name not in UNITS:
            raise BadInput(f"super_twisting has no {name!r}{nearest(name, UNITS)}")
        if name in found:
            raise BadInput(f"--set names {name} twice; write it once")
        if not NUMBER.fullmatch(value) or re.search(r"/0+$", value):
            raise BadInput(
                f"{name}={value} is no finite number; write one in {UNITS[name]}, {name}=1.5"
            )
        found[name] = Fraction(value)
    missing = [name for name in UNITS if name not in found and name != "delta"]
    if missing:
        lacking = " ".join(f"{name}=VALUE" for name in missing)
        raise BadInput(f"super_twisting needs {', '.join(missing)}; add --set {lacking}")
    return found


def check(file: str) -> str:
    """Answer of ``slipctl check``.

    Raises:
        BadInput: it is no certificate.
        RunFailed: it does not hold.
    """
    payload = store.read_json(Path(file))
    try:
        return f"{file} holds: {certificate.check(payload)}"
    except certificate.DoesNotHold as error:
        raise RunFailed(f"{file} does not hold: {error}") from None
    except BadInput as error:
        raise BadInput(f"{file}: {error}") from None


def table(report: Report) -> str:
    """Report as text."""
    gains = ", ".join(f"{k} = {v:g} {UNITS[k]}" for k, v in report.gains.items())
    rows = [f"super_twisting: {report.verdict}", f"  {gains}", ""]
    names = ("largest_L", "largest_delta", "smallest_k1", "smallest_k2")
    head = "".join(f" {name.replace('_', ' '):>14}" for name in names)
    rows.append(f"  {'criterion':<18} {'verdict':<32}{head}")
    units = "".join(f" {UNITS[name.split('_')[1]]:>14}" for name in names)
    rows.append(f"  {'':<18} {'':<32}{units}")
    for name, f in report.criteria.items():
        ends = "".join(
            f" {'-' if f.margins[n] is None else format(f.margins[n], '.7g'):>14}" for n in names
        )
        mark = "*" if f.unit_dependent else ""
        rows.append(f"  {name + mark:<18} {f.verdict:<32}{ends}")
    rows.append("")
    if any(f.unit_dependent for f in report.criteria.values()):
        rows.append("  * its verdict depends on the unit of length")
    w = report.witness
    rows.append(f"  worst disturbance: {w.law}")
    rows.append(f"  with it |x2| at a crossing of x1 = 0 is {w.growth:.6g} times that before")
    least, most = report.reaching
    if report.verdict == "CERTIFIED":
        rows.append(f"  longest reaching time: {least:.6g} to {most:.6g} s per m/s^2 of x2")
    return "\n".join(rows)
