"""Files that nobody vouches for: one line, no traceback, no waiting, whatever stands in them."""

from __future__ import annotations

import json
import os
import random
from fractions import Fraction
from pathlib import Path

import pytest

from slipctl.certify import certificate, proofs
from slipctl.certify.catalogue import SYSTEMS
from slipctl.commands.cli import main
from slipctl.errors import BadInput


@pytest.fixture(autouse=True)
def place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Run in an empty folder."""
    monkeypatch.chdir(tmp_path)
    return tmp_path


def written() -> str:
    """A certificate that holds."""
    numbers = {"k1": Fraction(2), "k2": Fraction(11, 10), "L": Fraction(1)}
    payload = proofs.write(SYSTEMS["super_twisting"], numbers)
    return json.dumps(payload)


def refused(path: str, said: str, capsys: pytest.CaptureFixture[str], code: int = 2) -> None:
    assert main(["check", path]) == code
    found = capsys.readouterr()
    assert found.out == ""
    assert found.err.count("\n") == 1
    assert said in found.err
    assert len(found.err) < 400


@pytest.mark.parametrize(("text", "said"), [
    ("[" * 100_000, "no JSON file"),
    ("{\"a\": " * 5_000, "no JSON file"),
    ('{"format": 2, "kind": ' + "[" * 500 + "]" * 500 + "}", "nested more than 20 deep"),
    ('{"format": 2, "kind": "certificate", "kind": "certificate"}', "'kind' stands in it twice"),
    ('{"format": 2, "asked": {"k1": {"value": "2", "value": "3"}}}', "'value' stands in it twice"),
    ('{"format": 1.0, "kind": "certificate"}', "1.0 stands in it as a number"),
    ('{"format": 1e999, "kind": "certificate"}', "1e999 stands in it as a number"),
    ('{"format": NaN, "kind": "certificate"}', "NaN stands in it as a number"),
    ('{"format": -Infinity, "kind": "certificate"}', "-Infinity stands in it as a number"),
    ('{"format": %s, "kind": "certificate"}' % ("9" * 5000), "more than 300 digits"),
    ('{"format": true, "kind": "certificate"}', "its format is True, it must be 2"),
    ('{"format": 0, "kind": "certificate"}', "its format is 0, it must be 2"),
    ('{"format": -2, "kind": "certificate"}', "its format is -2, it must be 2"),
    ('{"format": "2", "kind": "certificate"}', "its format is '2', it must be 2"),
    ('{"format": null, "kind": "certificate"}', "its format is None, it must be 2"),
    ('{"kind": "certificate"}', "its format is None, it must be 2"),
    ('{"format": 1, "kind": "certificate"}', "leaves out what its proofs did not use"),
    ('{"format": 3, "kind": "certificate"}', "update slipctl"),
    ('{"format": 2, "kind": "certificate", "system": ["a\\nb"]}', "no check for the system list"),
    ('{"format": 2, "kind": "certificate", "system": "a\\nb"}', "no check for the system 'a\\nb'"),
    ('{"format": 2, "kind": "plot"}', "it is no certificate"),
    ("[1, 2]", "no JSON file"), ("", "no JSON file"), ('"x"', "no JSON file"),
    ("\ud800", "no JSON file"),
])  # fmt: skip
def test_text_that_is_no_certificate(capsys, text, said):
    Path("a.json").write_bytes(text.encode("utf-8", "surrogatepass"))
    refused("a.json", said, capsys)


def test_places_that_are_no_files(capsys):
    """A pipe that nobody writes to, a device that never ends, a folder, a broken link."""
    os.mkfifo("pipe")
    refused("pipe", "is no regular file", capsys)
    refused("/dev/zero", "is no regular file", capsys)
    Path("folder").mkdir()
    refused("folder", "Is a directory", capsys)
    Path("link").symlink_to("nowhere")
    refused("link", "cannot read", capsys)
    refused("nul\0l", "null character", capsys)


def test_ten_megabytes_are_read_and_more_are_refused(capsys):
    text = written()
    Path("a.json").write_text(text + " " * (10_000_000 - len(text)))
    assert main(["check", "a.json"]) == 0
    capsys.readouterr()
    Path("a.json").write_text(text + " " * (10_000_001 - len(text)))
    refused("a.json", "more than 10 MB", capsys)


@pytest.mark.parametrize(
    "digits", ["２", "٢", "२", "2_0", " 2", "+2", "2.0", "2e0", "0x2", "-", ""]
)
def test_digits_of_other_scripts(capsys, digits):
    """Python's int reads them all; a file has one way to write a number."""
    text = written().replace('"value": "2"', f'"value": "{digits}"')
    Path("a.json").write_text(text, encoding="utf-8")
    refused("a.json", "asked.k1", capsys)


def test_numbers_that_take_long(capsys):
    """Rationals of the most digits that are read, in every place of every certificate."""
    long = "9" * 200 + "/" + "7" * 199 + "1"
    Path("a.json").write_text(written().replace('"2"', f'"{long}"'))
    assert main(["check", "a.json"]) in (1, 2)
    assert capsys.readouterr().err.count("\n") == 1
    text = written().replace('"627/250"', f'"{long}"')
    Path("a.json").write_text(text)
    assert main(["check", "a.json"]) == 1


def mutated(value, seeded, junk):
    """Copy with one place changed."""
    if isinstance(value, dict) and value and seeded.random() < 0.9:
        key = seeded.choice(list(value))
        return {k: mutated(v, seeded, junk) if k == key else v for k, v in value.items()}
    if isinstance(value, list) and value and seeded.random() < 0.9:
        i = seeded.randrange(len(value))
        return [mutated(v, seeded, junk) if k == i else v for k, v in enumerate(value)]
    return seeded.choice(junk)


@pytest.mark.parametrize("name", SYSTEMS)
def test_junk_anywhere_is_refused(name):
    """300 random changes of the certificate of each system's first panel: one of two errors."""
    own, seeded = SYSTEMS[name], random.Random(5)
    numbers = dict(own.panel[0]) if own.panel else {}
    for k, n in own.numbers.items():
        if n.value is None and not n.optional:
            numbers.setdefault(k, 0.5)
    payload = json.loads(json.dumps(proofs.write(own, numbers)))
    certificate.check(payload)
    junk = (None, 0, 1, -1, True, "", "x", "0", "-1", "1/3", [], [[]], {}, {"a": 1}, "9" * 5000,
            "1/0", ["1"] * 5, {"value": "1"}, "CERTIFIED", "REFUTED", "UNDECIDED")  # fmt: skip
    for _ in range(300):
        wrong = mutated(payload, seeded, junk)
        if wrong != payload:
            with pytest.raises((certificate.DoesNotHold, BadInput)):
                certificate.check(wrong)
