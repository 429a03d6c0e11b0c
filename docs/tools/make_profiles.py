"""The profiles of ``all_rails``: ``python docs/tools/make_profiles.py`` writes their picture.

docs/profiles_all_rails.svg is drawn from the table ``profile`` of the experiment ``fair`` in
docs/evidence/all_rails.json.
"""

from __future__ import annotations

import json
from pathlib import Path

from slipctl import Table
from slipctl.draw.plots import svg_text
from slipctl.studies.all_rails.study import profile_panels

HERE = Path(__file__).resolve().parents[1]


def main() -> None:
    """Write the picture."""
    evidence = json.loads((HERE / "evidence" / "all_rails.json").read_text(encoding="utf-8"))
    t = evidence["numbers"]["tables"]["experiments"]["fair"]["profile"]
    columns = {c: (v["unit"], v["values"]) for c, v in t["columns"].items()}
    text = svg_text(profile_panels(Table(t["title"], columns, t["doc"])))
    (HERE / "profiles_all_rails.svg").write_text(text, encoding="utf-8", newline="\n")


if __name__ == "__main__":
    main()
