"""No import, path or call that only Linux has; the quick part of the suite under Windows' rules."""

from __future__ import annotations

import ast
import os
import subprocess
import sys
from pathlib import Path

import pytest

import slipctl as sc
from slipctl import BadInput
from slipctl.commands.cli import main
from slipctl.run import store

ROOT = Path(__file__).parents[2]
FILES = [p for folder in ("slipctl", "models", "studies", "bench")
         for p in sorted((ROOT / folder).rglob("*.py"))]  # fmt: skip

ONLY_POSIX = {
    "fcntl", "resource", "termios", "pwd", "grp", "pty", "tty", "syslog", "posix", "crypt", "spwd",
}  # fmt: skip
GUARDED = {
    "fork", "killpg", "getuid", "geteuid", "setsid", "mkfifo", "uname", "getpgid", "setitimer",
    "ITIMER_REAL", "SIGALRM", "SIGKILL", "SIGHUP", "pthread_sigmask", "sched_getaffinity",
    "WIFEXITED", "RTLD_NOW", "statvfs", "chown", "nice", "register_at_fork",
    "set_wakeup_fd", "waitpid",
}  # fmt: skip
"""Names that exist on some systems only: they are used where ``hasattr`` or a system is asked."""

ALLOWED = {
    "slipctl/run/machine.py": {"sched_getaffinity", "/proc/cpuinfo"},
    "bench/sweeps.py": {"/proc/self/status"},
    "slipctl/study/jobs.py": {"fork", "setitimer", "ITIMER_REAL", "pthread_sigmask"},
    "slipctl/run/store.py": {"fcntl", "register_at_fork"},
    "slipctl/workbench/web/worker.py": {"resource"},
    "slipctl/run/interrupts.py": {"setitimer", "ITIMER_REAL"},
}
"""Where such a name is asked for first."""

PATHS = ("/dev/", "/tmp", "/usr/", "/proc/", "/etc/", "/opt/", "/bin/", "/var/", "~/")


@pytest.mark.parametrize("path", FILES, ids=lambda p: p.relative_to(ROOT).as_posix())
def test_nothing_that_only_linux_has(path: Path) -> None:
    """Imports, names of ``os`` and ``signal``, and paths in texts that are no documentation."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    found: set[str] = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            found |= {a.name for a in node.names} & ONLY_POSIX
        elif isinstance(node, ast.ImportFrom):
            found |= {node.module or ""} & ONLY_POSIX
        elif isinstance(node, ast.Attribute):
            found |= {node.attr} & GUARDED
        elif isinstance(node, ast.Constant) and isinstance(node.value, str):
            if node.value.startswith(PATHS) and "\n" not in node.value:
                found.add(node.value)
        elif isinstance(node, ast.Call):
            found |= without_encoding(node)
    assert found <= ALLOWED.get(path.relative_to(ROOT).as_posix(), set())


def without_encoding(call: ast.Call) -> set[str]:
    """Text that would be read or written as the system likes: not UTF-8 on Windows."""
    name = call.func.attr if isinstance(call.func, ast.Attribute) else ""
    if name not in ("read_text", "write_text") or (
        isinstance(call.func, ast.Attribute)
        and isinstance(call.func.value, ast.Name)
        and call.func.value.id in ("store", "files")  # ours: always UTF-8
    ):
        return set()
    place = 0 if name == "read_text" else 1
    if len(call.args) > place or any(k.arg == "encoding" for k in call.keywords):
        return set()
    return {f"{name} without an encoding, line {call.lineno}"}


# ---- names that Windows keeps for itself ---------------------------------------------------------


@pytest.mark.parametrize("name", ["CON", "nul", "Aux.json", "com1", "lpt9.c", "a/PRN/b", "con .x"])
def test_a_device_is_no_name_of_an_output(name, tmp_path):
    with pytest.raises(BadInput, match="is a device on Windows; choose another name"):
        store.check_folder(tmp_path / name)
    with pytest.raises(BadInput, match="is a device on Windows; choose another name"):
        store.check_file(tmp_path / name)


@pytest.mark.parametrize("name", ["console", "null.json", "auxiliary", "com10", "com", "lpt0"])
def test_a_name_like_that_of_a_device_is_taken(name, tmp_path):
    assert store.check_folder(tmp_path / name) is None


@pytest.mark.parametrize(
    "words",
    [
        "run subway_braking --loop sta --scenario base --quick --out nul",
        "certify super_twisting --set k1=1.5 k2=1.1 L=1 --out con.json",
        "copy double_exponential aux.py",
        "c double_exponential --out prn",
        "fit curve.csv --law double_exponential --out com1",
        "pil subway_braking:sta --out lpt1.json",
    ],
)
def test_every_command_refuses_a_device(words, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    Path("curve.csv").write_text(
        "v_s [m/s],mu\n0.1,0.05\n0.8,0.2\n2,0.2\n4,0.1\n", encoding="utf-8"
    )
    assert main(words.split()) == 2
    said = capsys.readouterr().err
    assert "is a device on Windows" in said
    assert len(said.strip().splitlines()) == 1
    assert [p.name for p in tmp_path.iterdir()] == ["curve.csv"]


def test_a_module_in_c_is_no_device(tmp_path):
    """Its name becomes that of files: ``aux.c`` cannot be unpacked on Windows."""
    from slipctl.models.huang_2020.subway_braking import double_exponential

    with pytest.raises(BadInput, match="Windows keep it"):
        sc.c_module(double_exponential, tmp_path / "out", name="aux")


# ---- the quick part of the suite as on Windows ---------------------------------------------------

WINDOWS = """\
import os, platform, signal, sys
import pytest

class Windows:
    # while the tests run, not while pytest and its plugins look for what they have
    def pytest_collection(self):
        for name in ("SIGALRM", "SIGKILL", "SIGHUP", "setitimer", "ITIMER_REAL", "pthread_sigmask"):
            delattr(signal, name)
        for name in ("fork", "getuid", "geteuid", "killpg", "setsid", "mkfifo", "getpgid"):
            delattr(os, name)
        sys.platform = "win32"
        platform.system = lambda: "Windows"

    def pytest_sessionfinish(self):
        sys.platform = "linux"

rename = os.replace
def replace(old, new):  # no file gets a name that Windows cannot have
    assert not set(os.path.basename(os.fspath(new))) & set('<>:"|?*'), new
    rename(old, new)
os.replace = replace
import casadi, matplotlib.pyplot, netCDF4, scipy.optimize, xarray, multiprocessing.connection
for name in ("psutil", "dask", "distributed", "zarr"):  # of extras: they ask for the system once
    try:
        __import__(name)
    except ImportError:
        pass
sys.exit(pytest.main(sys.argv[1:], plugins=[Windows()]))
"""
"""What a system lacks is taken away before slipctl is imported; names of files are looked at."""


@pytest.mark.long
def test_the_quick_part_of_the_suite_passes_as_on_windows(tmp_path):
    """Without fork, timers and signals of POSIX, and with ``sys.platform`` of Windows."""
    script = tmp_path / "windows.py"
    script.write_text(WINDOWS, encoding="utf-8")
    quick = ["run/test_rail.py", "estimate/test_curve_fit.py", "study/test_jobs.py"]
    done = subprocess.run(
        [sys.executable, str(script), "-n", "0", "-p", "no:cacheprovider", "-x",
         "-k", "not confidence and not wherever",  # numbers of fits: no system has a say in them
         *(f"tests/{name}" for name in quick)],
        cwd=ROOT, capture_output=True, text=True, env=os.environ | {"LOGNAME": "tester"},
    )  # fmt: skip
    assert done.returncode == 0, done.stdout[-3000:] + done.stderr[-1000:]
