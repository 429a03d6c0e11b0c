"""The maps of the papers' laws: ``python docs/tools/make_maps.py [NAME ...]``, docs/map_*.svg.

Each is what ``slipctl certify STUDY:GAINS --map X,Y --metric M`` draws. Takes some minutes.
"""

from __future__ import annotations

import contextlib
import sys
import tempfile
from pathlib import Path

from slipctl.commands.cli import main

HERE = Path(__file__).resolve().parents[1]
MAPS = {
    "subway_braking": ("subway_braking:sta", "k1=1:200,k2=0.5:100", "torque_ripple"),
    "hst_braking": ("hst_braking:eppfc_steady", "K1=1:5000,eta_inf=5e-5:0.05", "distance"),
    "hst_traction": ("hst_traction:hosm", "k4=0.02:5,beta=0.005:5", "speed_error_rms"),
    "freight_traction": ("freight_traction:barrier", "k=50:5000,k_s=0.005:0.2", "distance"),
}


def draw(name: str) -> None:
    """Write a map."""
    of, axes, metric = MAPS[name]
    with tempfile.TemporaryDirectory() as folder, contextlib.chdir(folder):
        if main(["-q", "certify", of, "--map", axes, "--metric", metric, "--points", "21",
                 "--out", "map"]):  # fmt: skip
            raise SystemExit(f"the map of {of} failed")
        text = Path("map", "map.svg").read_text(encoding="utf-8")
    (HERE / f"map_{name}.svg").write_text(text, encoding="utf-8", newline="\n")


if __name__ == "__main__":
    for wanted in sys.argv[1:] or MAPS:
        draw(wanted)
