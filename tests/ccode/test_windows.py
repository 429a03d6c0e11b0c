"""What is written runs on Windows: cross-compiled by MinGW-w64, run by Wine, the same numbers.

Both are skipped where a tool is missing; CI installs them.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import zipfile
from pathlib import Path

import numpy as np
import pytest

from slipctl import BadInput, Input, Output, Param, State, step
from slipctl.ccode import codegen
from slipctl.ccode.compile.platforms import MINGW, platforms, this_platform
from slipctl.ccode.module.plan import Plan

WINE = next((p for p in ("wine64", "wine", "/usr/lib/wine/wine64") if shutil.which(p)), None)
needs_mingw = pytest.mark.skipif(shutil.which(MINGW) is None, reason="no MinGW-w64 here")
needs_wine = pytest.mark.skipif(WINE is None, reason="no Wine here")


@step(period=0.01, y=Output("m", "lagged", lo=-100, hi=100))
def lag(
    x=State("m", 0.5, "lagged"),
    u=Input("m", "wanted", lo=-100, hi=100),
    tau=Param("s", 0.13, "time constant", lo=0.02, hi=10),
):
    """First-order lag."""
    return {"x": x + 0.01 / tau * (u - x)}, {"y": x + 0.01 / tau * (u - x)}


def wine(folder: Path, *words: str | Path) -> subprocess.CompletedProcess:
    environment = os.environ | {"WINEPREFIX": str(folder / "wine"), "WINEDEBUG": "-all"}
    environment.pop("DISPLAY", None)
    return subprocess.run(
        [WINE, *map(str, words)], env=environment, capture_output=True, text=True, timeout=300
    )


@pytest.mark.second
@needs_mingw
def test_an_fmu_holds_a_binary_for_each_platform(tmp_path):
    """One archive, opened on Linux and on Windows; the same source gives the same bytes."""
    made = [codegen.export(lag, tmp_path / k, fmus=True).folder for k in "ab"]
    for version, places in ((2, {"win64"}), (3, {"x86_64-windows"})):
        names = [f / f"lag_fmi{version}.fmu" for f in made]
        assert names[0].read_bytes() == names[1].read_bytes()
        with zipfile.ZipFile(names[0]) as archive:
            found = {n.split("/")[1] for n in archive.namelist() if n.startswith("binaries/")}
            dll = archive.read(f"binaries/{next(iter(places))}/lag.dll")
        assert places <= found
        assert len(found) == 1 + (this_platform() is not None)
        assert dll[:2] == b"MZ"


@pytest.mark.long
@needs_mingw
@needs_wine
def test_the_library_for_windows_gives_the_numbers_of_python(tmp_path):
    """The functions of FMI 2.0, loaded from the DLL, against the block, bit for bit."""
    report = codegen.export(lag, tmp_path / "c", fmus=True, platforms=["win64"])
    with zipfile.ZipFile(report.folder / "lag_fmi2.fmu") as archive:
        (tmp_path / "lag.dll").write_bytes(archive.read("binaries/win64/lag.dll"))
        text = archive.read("modelDescription.xml").decode()
    token = text.split('guid="')[1].split('"')[0]
    outputs = [line for line in text.split("<ScalarVariable")[1:] if 'causality="output"' in line]
    number = next(v for v in outputs if 'name="y"' in v).split('valueReference="')[1].split('"')[0]
    driver = Path(__file__).with_name("fmi2_driver.c")
    subprocess.run([MINGW, "-O1", str(driver), "-o", str(tmp_path / "driver.exe")], check=True)
    inputs = np.round(30 * np.sin(np.arange(40) / 3), 6)
    done = wine(tmp_path, tmp_path / "driver.exe", tmp_path / "lag.dll", token, "0.01", number,
                *map(str, inputs))  # fmt: skip
    assert done.returncode == 0, done.stderr
    got, state = [float.fromhex(word) for word in done.stdout.split()], {"x": 0.5}
    for u, y in zip(inputs, got, strict=True):
        state, wanted = lag(**state, u=u)
        assert y == wanted["y"]


@pytest.mark.long
@needs_mingw
@needs_wine
def test_the_written_test_passes_on_windows(tmp_path):
    """The test that goes with a module, built by MinGW and run by Wine."""
    folder = codegen.export(lag, tmp_path / "c").folder
    sources = [str(folder / n) for n in ("lag.c", "test_lag.c")]
    built = [MINGW, "-std=c99", "-O2", "-ffp-contract=off", "-D__USE_MINGW_ANSI_STDIO=1", *sources]
    subprocess.run([*built, "-o", str(tmp_path / "test.exe"), "-lm"], check=True)
    done = wine(tmp_path, tmp_path / "test.exe", folder / "vectors.txt")
    assert done.returncode == 0, done.stdout + done.stderr


def test_platforms_that_cannot_be_are_refused(tmp_path, monkeypatch):
    with pytest.raises(BadInput, match="there is no platform 'win32'; did you mean 'win64'"):
        platforms(["win32"])
    with pytest.raises(BadInput, match="ask for these too"):
        codegen.export(lag, tmp_path / "c", platforms=["win64"])
    monkeypatch.setattr("shutil.which", lambda name: None)
    with pytest.raises(BadInput, match=r"no compiler for win64: install MinGW-w64"):
        platforms(["win64"])


def test_sources_of_a_module_know_no_platform():
    """Header and source include the C library alone, so that any compiler takes them."""
    texts = codegen.texts(Plan(lag, None, None, "double"))
    own = {n: t for n, t in texts.items() if n in ("lag.c", "lag.h")}
    assert len(own) == 2
    for name, text in own.items():
        for word in ("_WIN32", "__linux__", "unistd.h", "windows.h", "__GNUC__"):
            assert word not in text, f"{name}: {word}"
