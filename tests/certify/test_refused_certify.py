"""Files and numbers that certify cannot use: a line says what is wrong and what is wanted."""

from __future__ import annotations

import json
import os
from fractions import Fraction
from pathlib import Path

import pytest

from slipctl import BadInput
from slipctl.certify import boundary, certificate, safe_json
from slipctl.certify.arithmetic import binomial
from slipctl.certify.catalogue import SYSTEMS
from slipctl.design.gain_points import replaced_numbers
from slipctl.models.super_twisting.certificate import twisting_report

OBSERVER = replaced_numbers(SYSTEMS["load_observer"], {})

FILES = {
    "deep": (b'{"a":' * 21 + b"1" + b"}" * 21, "nested more than 20 deep; a certificate has fewer"),
    "twice": (b'{"a": "1", "a": "2"}', "the entry 'a' stands in it twice"),
    "digits": (b'{"a": ' + b"1" * 301 + b"}", "more than 300 digits"),
    "float": (b'{"a": 1.5}', "1.5 stands in it as a number; certificates have texts such as '3/2'"),
    "nan": (b'{"a": NaN}', "NaN stands in it as a number"),
    "list": (b"[1]", "is no JSON file of slipctl"),
    "text": (b"\xff", "is no JSON file of slipctl"),
    "large": (b" " * (safe_json.LARGEST + 1), "has more than 10 MB; a certificate has less"),
}


@pytest.mark.parametrize("what", FILES)
def test_a_file_is_refused(what: str, tmp_path: Path) -> None:
    raw, words = FILES[what]
    (tmp_path / "a.json").write_bytes(raw)
    with pytest.raises(BadInput, match=words):
        safe_json.read(tmp_path / "a.json")


def test_what_is_at_the_limit_is_read(tmp_path: Path) -> None:
    raw = b'{"a":' * 20 + b'"1"' + b"}" * 20
    (tmp_path / "a.json").write_bytes(raw + b" " * (safe_json.LARGEST - len(raw)))
    assert safe_json.read(tmp_path / "a.json")
    (tmp_path / "b.json").write_bytes(b'{"a": ' + b"1" * 300 + b"}")
    assert safe_json.read(tmp_path / "b.json") == {"a": int("1" * 300)}


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no pipes here")
def test_what_is_no_file_is_refused(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    for path, words in ((tmp_path / "pipe", "is no regular file"), (Path("a\0b"), "null character"),
                        (tmp_path / "none", "cannot read .*none: No such file")):  # fmt: skip
        with pytest.raises(BadInput, match=words):
            safe_json.read(path)


HALF = Fraction(1, 2)
BAD = {
    "count": (lambda: binomial.holds(3, 4, HALF, HALF), "4 of 3 draws is no count"),
    "share": (lambda: binomial.holds(3, 1, Fraction(2), HALF), "a share lies in 0 .. 1"),
    "chance": (lambda: binomial.holds(3, 1, HALF, Fraction(1)), "the chance of an error between"),
    "draws": (
        lambda: binomial.draws_needed(Fraction(1, 10**9), Fraction(1, 10**9)), "draws are needed"),
    "gain": (lambda: twisting_report.exact_gains(float("nan"), 1, 1), "k1 = nan is no finite"),
    "no gain": (lambda: twisting_report.exact_gains(1, 1, 0), "must be more than 0; without a"),
    "delta": (lambda: twisting_report.exact_gains(1, 1, 1, -1), "must be 0 or more"),
    "far": (lambda: twisting_report.exact_gains(1e31, 1, 1), "must lie between 1e-30 and 1e30"),
    "close": (
        lambda: twisting_report.exact_gains(1, 1 + Fraction(1, 10**20), 1), "move them apart"),
    "sign": (
        lambda: boundary.farthest(OBSERVER, "L2"), "L2 may be negative; ask"),
    "name": (lambda: boundary.farthest(OBSERVER, "L3"), "has no 'L3'"),
    "format": (
        lambda: certificate.check({"kind": certificate.KIND, "format": 99}), "has format 99"),
    "kind": (lambda: certificate.check({"kind": "x"}), "it is no certificate; slipctl certify"),
}  # fmt: skip


@pytest.mark.parametrize("what", BAD)
def test_numbers_are_refused(what: str) -> None:
    call, words = BAD[what]
    with pytest.raises(BadInput, match=words):
        call()


GUARDS = {
    ("perturbation_seek", "k"): (0, "k = 0 seeks nothing; write another number"),
    ("perturbation_seek", "curvature"): (0, "curvature = 0 seeks nothing"),
    ("rls", "forgetting"): (2, "forgetting = 2 must be above 0 and at most 1"),
    ("filter", "band_samples"): (0, "band_samples = 0 must be 1 or more"),
    ("prescribed_performance", "slip"): (2, "slip = 2 must be at most 1, a locked wheel"),
}


@pytest.mark.parametrize(("name", "number"), GUARDS)
def test_a_system_guards_its_numbers(name: str, number: str) -> None:
    value, words = GUARDS[name, number]
    recorded = json.loads((Path(__file__).parent / "recorded.json").read_text(encoding="utf-8"))
    told = {k: Fraction(str(v)) for k, v in recorded[name]["cases"][0]["of"].items()}
    told = {k: n.value and Fraction(str(n.value)) for k, n in SYSTEMS[name].numbers.items()
            if n.value is not None} | told | {number: Fraction(value)}  # fmt: skip
    with pytest.raises(BadInput, match=words):
        SYSTEMS[name].guard(told)
