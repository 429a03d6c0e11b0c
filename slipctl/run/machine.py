"""What this machine has, and what decides the bits that it computes."""

from __future__ import annotations

import os
import platform
from functools import lru_cache
from pathlib import Path


def cores() -> int:
    """Cores that this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


@lru_cache(maxsize=1)
def processor() -> str:
    """Type of the processor, and the library of mathematics: ``"AMD EPYC 7B13, glibc 2.36"``."""
    try:
        text = Path("/proc/cpuinfo").read_text(encoding="utf-8", errors="replace")
    except OSError:
        text = ""
    rows = [[cell.strip() for cell in line.partition(":")[::2]] for line in text.splitlines()]
    found = dict(reversed(rows))  # the first core speaks for all
    name = found.get("model name") or " ".join(
        found[k] for k in ("CPU implementer", "CPU part") if k in found
    )
    library = " ".join(platform.libc_ver()).strip() or f"{platform.system()} {platform.release()}"
    return f"{name or platform.processor() or platform.machine()}, {library}"


def versions() -> dict[str, str]:
    """Versions that numbers depend on."""
    import casadi as ca
    import numpy as np

    from slipctl import __version__

    return {"slipctl": __version__, "casadi": ca.CasadiMeta.version(), "numpy": np.__version__}
