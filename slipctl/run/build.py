"""Compile a CasADi Function once and roll it over time in C; without a compiler nothing is lost.

Compiled libraries lie under the user's cache folder, keyed by the content of the Function, the
compiler and the flags. Each has a file beside it that holds key and checksum: a library that is
damaged or another's is built again, not loaded. A file is written under another name and renamed,
so that runs in parallel never see half a library.
"""

from __future__ import annotations

import ctypes
import hashlib
import logging
import os
import platform
import shutil
import subprocess
import tempfile
from collections.abc import Callable, Mapping, Sequence
from functools import lru_cache, partial
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np

from slipctl.block.block import Block
from slipctl.block.signals import packed_numbers

log = logging.getLogger("slipctl")

LONG = 100_000
"""Ticks from which on it is worth to let the compiler think longer."""

SHORT_LEVEL = ("-O1", "-ftree-vectorize")
"""Level for shorter runs: compiles in 0.4 of the time and rolls in 1.2; the bits are the same."""

FLAGS = (
    "-O2", "-ffp-contract=off", "-fno-semantic-interposition",
    "-fno-builtin-exp", "-fno-builtin-log", "-fno-builtin-pow",
)  # fmt: skip
"""Never fast-math: the compiled Function gives the bits of CasADi's virtual machine."""

_ROLL = """
#include <string.h>
/* Roll (x, u, p) -> (n, y) over ticks; returns the number of ticks done, fewer than asked if a
   state became NaN or infinite (the broken state is then in x). */
long long slipctl_roll(long long ticks, long long nx, long long nu, long long ny, double* x,
                       const double* u, const double* p, double* x_log, double* y_log,
                       double* next, const double** arg, double** res, casadi_int* iw, double* w) {
  long long k, i, broken;
  for (k = 0; k < ticks; ++k) {
    memcpy(x_log + k * nx, x, (size_t)nx * sizeof(double));
    arg[0] = x; arg[1] = u + k * nu; arg[2] = p;
    res[0] = next; res[1] = y_log + k * ny;
    FUNCTION(arg, res, iw, w, 0);
    memcpy(x, next, (size_t)nx * sizeof(double));
    for (i = 0, broken = 0; i < nx; ++i) broken |= !(x[i] - x[i] == 0.0);
    if (broken) return k;
  }
  return ticks;
}
"""

_HEAD = """#include <math.h>
#if defined(__GNUC__) && !defined(__clang__)
/* Several elements of a vector at a time; a short loop that clears or copies stays a loop. */
#pragma GCC optimize ("vect-cost-model=dynamic", "no-tree-loop-distribute-patterns")
#define SLIPCTL_WIDE __attribute__((optimize("O3")))
#else
#define SLIPCTL_WIDE
#endif
#if defined(__x86_64__) && defined(__GLIBC__)
/* What CasADi's virtual machine gives, zeros and NaN too: of equal ones the first. No call. */
static inline double slipctl_fmin(double x, double y) { return y < x || x != x ? y : x; }
static inline double slipctl_fmax(double x, double y) { return y > x || x != x ? y : x; }
#define fmin slipctl_fmin
#define fmax slipctl_fmax
/* Exactly what the library gives, without a call where it gives back its argument. */
static inline double slipctl_pow(double x, double y) {
  return y == 1.0 || x == 1.0 ? x : pow(x, y);
}
#define pow slipctl_pow
#endif
"""

_DENSE = "void casadi_mtimes_dense("

_DENSE_LOOP = """      for (j=0; j<nrow_x; ++j) {
        for (k=0; k<ncol_x; ++k) {
          z[j + i*nrow_x] += x[j + k*nrow_x] * y[k + i*ncol_x];
"""

_EIGHT_ROWS = """      for (j=0; j+8<=nrow_x; j+=8) {
        casadi_real sum[8];
        casadi_int r;
        for (r=0; r<8; ++r) sum[r] = z[j + r + i*nrow_x];
        for (k=0; k<ncol_x; ++k) {
          for (r=0; r<8; ++r) sum[r] += x[j + r + k*nrow_x] * y[k + i*ncol_x];
        }
        for (r=0; r<8; ++r) z[j + r + i*nrow_x] = sum[r];
      }
      for (; j<nrow_x; ++j) {
        for (k=0; k<ncol_x; ++k) {
          z[j + i*nrow_x] += x[j + k*nrow_x] * y[k + i*ncol_x];
"""

_SPARSE_LOOP = """  } else {
    for (cc=0; cc<ncol_y; ++cc) {
      casadi_int kk;
      for (kk=colind_z[cc]; kk<colind_z[cc+1]; ++kk) {
        w[row_z[kk]] = z[kk];
"""

_ON_A_VECTOR = """  } else if (ncol_y == 1 && colind_y[1] == sp_y[0] && colind_z[1] == sp_z[0]) {
    casadi_int k, at;
    for (k=0; k<sp_y[0]; ++k) {
      for (at=colind_x[k]; at<colind_x[k+1]; ++at) z[row_x[at]] += x[at]*y[k];
    }
"""


@lru_cache(maxsize=1)
def compiler() -> str | None:
    """Path of a C compiler (``$CC``, cc, gcc or clang), or None."""
    for name in (os.environ.get("CC"), "cc", "gcc", "clang"):
        found = shutil.which(name) if name else None
        if found:
            return found
    return None


@lru_cache(maxsize=4)
def _compiler_version(path: str) -> str:
    return subprocess.run([path, "--version"], capture_output=True, text=True).stdout.split("\n")[0]


def identity() -> str:
    """What the compiler says it is, asked once; empty where there is none."""
    cc = compiler()
    return "" if cc is None else _compiler_version(cc)


def cache_folder() -> Path:
    """Folder of compiled Functions: ``$SLIPCTL_CACHE``, else the user's cache folder."""
    chosen = os.environ.get("SLIPCTL_CACHE")
    if chosen:
        return Path(chosen)
    base = os.environ.get("XDG_CACHE_HOME") or os.path.join(os.path.expanduser("~"), ".cache")
    return Path(base) / "slipctl"


class Roller:
    """A compiled Function (x, u, p) -> (n, y), called over many ticks at once.

    It runs outside Python's lock, so that threads use all cores. ``function`` is that of CasADi.
    """

    def __init__(self, f: ca.Function, library: Path) -> None:
        self.f = f
        lib = ctypes.CDLL(str(library))
        self._roll = lib.slipctl_roll
        self._roll.restype = ctypes.c_longlong
        self.function = lib[f.name()]
        sizes = [ctypes.c_longlong() for _ in range(4)]
        lib[f"{f.name()}_work"](*[ctypes.byref(s) for s in sizes])
        arg, res, iw, w = (max(int(s.value), 1) for s in sizes)
        self._work = max(arg, 3), max(res, 2), iw, w

    def roll(
        self, x: np.ndarray, u: np.ndarray, p: np.ndarray, x_log: np.ndarray, y_log: np.ndarray
    ) -> int:
        """Advance ``x`` in place over ``len(u)`` ticks, filling the logs (ticks by signals).

        Returns:
            Ticks completed; fewer than asked when a state became NaN or infinite.
        """
        wanted = (self.f.size1_in(0), self.f.size1_in(1), self.f.size1_in(2), self.f.size1_out(1))
        if (x.size, u.shape[1], p.size, y_log.shape[1]) != wanted or x_log.shape[1] != x.size:
            raise ValueError(f"{self.f.name()} takes x, u, p, y of sizes {wanted}")
        if any(a.dtype != float or not a.flags.c_contiguous for a in (x, u, p, x_log, y_log)):
            raise ValueError(f"{self.f.name()} takes contiguous arrays of doubles")
        arg, res, iw, w = self._work  # memory of this call alone: threads roll side by side
        following, scratch = np.zeros(max(x.size, 1)), np.zeros(w)
        return int(
            self._roll(
                *(ctypes.c_longlong(n) for n in (len(u), x.size, u.shape[1], y_log.shape[1])),
                *(ctypes.c_void_p(a.ctypes.data) for a in (x, u, p, x_log, y_log, following)),
                (ctypes.c_void_p * arg)(), (ctypes.c_void_p * res)(), (ctypes.c_longlong * iw)(),
                ctypes.c_void_p(scratch.ctypes.data),
            )
        )  # fmt: skip


def compile_roller(f: ca.Function, ticks: int = LONG) -> Roller | None:
    """Compile ``f`` or take it from the cache; None where there is no compiler or it fails.

    Args:
        f: what is rolled.
        ticks: how long the roll will be; a short one is not worth the best code.
    """
    cc = compiler()
    if cc is None:
        return None
    folder, content = cache_folder(), _content(f)
    best = FLAGS
    levels = [best] if ticks >= LONG else [best, (*SHORT_LEVEL, *FLAGS[1:])]
    keys = [_key(content, cc, flags) for flags in levels]
    try:
        for key in keys:
            library = folder / f"{key}.so"
            if not library.exists():
                continue
            if _whole(library, key):
                return Roller(f, library)
            log.warning("%s in the cache is damaged, building it again", library.name)
            library.unlink(missing_ok=True)
            _seal(library).unlink(missing_ok=True)
        folder.mkdir(parents=True, exist_ok=True)
        library = folder / f"{keys[-1]}.so"
        _build(f, cc, levels[-1], library, keys[-1])
        return Roller(f, library)
    except (OSError, AttributeError, subprocess.SubprocessError, RuntimeError) as error:
        log.warning("cannot compile %s, going on without: %s", f.name(), error)
        return None


@lru_cache(maxsize=4)
def _content(f: ca.Function) -> str:
    """All that makes a Function what it is; for a train it takes as long as a second of its run."""
    return str(f.serialize())


def _key(content: str, cc: str, flags: Sequence[str]) -> str:
    """Hash of everything that makes a library what it is."""
    parts = (
        content, ca.CasadiMeta.version(), _compiler_version(cc), platform.machine(),
        " ".join(flags), _hastened(_DENSE + _DENSE_LOOP + _SPARSE_LOOP) + _ROLL, "sealed",
    )  # fmt: skip
    return hashlib.sha256("".join(parts).encode()).hexdigest()[:32]


def _seal(library: Path) -> Path:
    """File beside a library that holds its key and checksum."""
    return library.with_suffix(".sum")


def _sum(library: Path, key: str) -> str:
    return f"{key} {hashlib.sha256(library.read_bytes()).hexdigest()}\n"


def _whole(library: Path, key: str) -> bool:
    """Whether a library is the one that was built under this key."""
    try:
        return _seal(library).read_text(encoding="utf-8") == _sum(library, key)
    except (OSError, UnicodeDecodeError):
        return False


BUILDING = ".build."
"""How the name of a folder begins in which a process compiles; its number follows."""


def _clear(folder: Path) -> None:
    """Remove folders of compiles whose process is gone."""
    for path in folder.glob(f"{BUILDING}*"):
        number = path.name[len(BUILDING) :].partition(".")[0]
        if number.isdigit() and not _alive(int(number)):
            shutil.rmtree(path, ignore_errors=True)


def _alive(number: int) -> bool:
    if os.name != "posix":  # there, asking whether a process lives would end it
        return True
    try:
        os.kill(number, 0)
    except ProcessLookupError:
        return False
    except PermissionError:
        pass
    return True


def _build(f: ca.Function, cc: str, flags: Sequence[str], library: Path, key: str) -> None:
    _clear(library.parent)
    place = f"{BUILDING}{os.getpid()}."
    with tempfile.TemporaryDirectory(prefix=place, dir=library.parent) as scratch:
        source = Path(scratch) / "roll.c"
        generator = ca.CodeGenerator("roll.c")
        generator.add(f)
        text = generator.dump()
        if "#error" in text:
            raise RuntimeError("CasADi cannot generate C for it")
        source.write_text(_hastened(text) + _ROLL.replace("FUNCTION", f.name()), encoding="utf-8")
        built, seal = Path(scratch) / "roll.so", Path(scratch) / "roll.sum"
        command = [cc, *flags, "-w", "-fPIC", "-shared", str(source), "-o", str(built), "-lm"]
        done = subprocess.run(command, capture_output=True, text=True)
        if done.returncode:
            said = done.stderr.strip().partition("\n")[0]
            raise RuntimeError(said or f"{cc} ended with code {done.returncode}")
        seal.write_text(_sum(built, key), encoding="utf-8")
        os.replace(seal, _seal(library))
        os.replace(built, library)


def _hastened(text: str) -> str:
    """C of CasADi that takes less time for the same bits.

    Smaller and larger of two without a call. A dense product eight rows at a time, a sparse one on
    a dense vector in place: each entry is summed in the same order as before.
    """
    if _DENSE_LOOP in text:
        text = text.replace(_DENSE, "SLIPCTL_WIDE " + _DENSE).replace(_DENSE_LOOP, _EIGHT_ROWS)
    return _HEAD + text.replace(_SPARSE_LOOP, _ON_A_VECTOR + _SPARSE_LOOP)


def roll_interpreted(
    f: ca.Function, x: np.ndarray, u: np.ndarray, p: np.ndarray, x_log: np.ndarray,
    y_log: np.ndarray,
) -> int:  # fmt: skip
    """Do what :meth:`Roller.roll` does, in CasADi's virtual machine."""
    now, following = np.array(x, dtype=float).ravel(), np.empty(f.size1_out(0))
    fed, output = np.empty(f.size1_in(1)), np.empty(f.size1_out(1))
    constants = np.array(p, dtype=float).ravel()
    pair: Any = f.buffer()
    buffer, call = pair
    for k, a in enumerate((now, fed, constants)):
        buffer.set_arg(k, memoryview(a))  # type: ignore[arg-type]
    for k, a in enumerate((following, output)):
        buffer.set_res(k, memoryview(a))  # type: ignore[arg-type]
    for k in range(len(u)):
        x_log[k], fed[:] = now, u[k]
        call()
        y_log[k], now[:] = output, following
        if not np.isfinite(now).all():
            x[:] = now
            return k
    x[:] = now
    return len(u)


def make_roller(f: ca.Function, compile: bool = True, ticks: int = LONG) -> Callable[..., int]:
    """What advances f over ``ticks``, ``(x, u, p, x_log, y_log) -> ticks done``.

    Compiled where there is a compiler (:meth:`Roller.roll`), else in CasADi's virtual machine; the
    numbers are the same.
    """
    roller = compile_roller(f, ticks) if compile else None
    return partial(roll_interpreted, f) if roller is None else roller.roll


def column(v: ca.DM | np.ndarray) -> np.ndarray:
    """Packed column of numbers as an array of one dimension."""
    return np.array(ca.DM(v).full()).ravel()


def pack_numbers(loop: Block, role: str, values: Mapping[str, Any]) -> np.ndarray:
    """Numbers of one role, packed as the loop's Function takes them."""
    numbers = packed_numbers(loop._signals[role], values)
    return column(loop.pack(role, values)) if numbers is None else numbers
