"""Build the pages beside those of other versions: python docs/tools/make_site.py FOLDER.

``FOLDER/0.1.0`` holds the pages of this version; those of others stay as they are. Each page lists
the versions at its side, ``FOLDER/index.html`` too. It all works from a folder, without a server.
"""

from __future__ import annotations

import html
import json
import re
import subprocess
import sys
from pathlib import Path

from slipctl import __version__
from slipctl.run import store

DOCS = Path(__file__).parents[1]


def versions(folder: Path) -> list[str]:
    """Versions whose pages are there, the newest first."""
    found = [p.parent.name for p in folder.glob("*/index.html")]
    return sorted(found, key=lambda v: [int(n) for n in re.findall(r"\d+", v)], reverse=True)


def listed(folder: Path) -> None:
    """Write what the pages read, and the page that leads to them."""
    there = versions(folder)
    store.write_text(folder / "versions.js", f"window.versions = {json.dumps(there)};\n")
    rows = "".join(f'<li><a href="{html.escape(v)}/index.html">{html.escape(v)}</a></li>\n'
                   for v in there)  # fmt: skip
    store.write_text(folder / "index.html", f"""<!doctype html>
<html lang="en"><meta charset="utf-8"><title>slipctl</title>
<meta http-equiv="refresh" content="0; url={html.escape(there[0])}/index.html">
<h1>slipctl</h1>
<ul>
{rows}</ul>
</html>
""")  # fmt: skip


def main() -> int:
    """Build into the folder that is named."""
    if len(sys.argv) != 2:
        print("write where: python docs/tools/make_site.py FOLDER")
        return 2
    folder = Path(sys.argv[1])
    command = [sys.executable, "-m", "sphinx", "-q", "-W", "-A", "several=1", str(DOCS),
               str(folder / __version__)]  # fmt: skip
    if code := subprocess.run(command, check=False).returncode:
        return code
    listed(folder)
    return 0


if __name__ == "__main__":
    sys.exit(main())
