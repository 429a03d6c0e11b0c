"""Files that slipctl writes, with something else in them."""

from __future__ import annotations

from pathlib import Path

from slipctl.models import vehicle

METRO = (Path(vehicle.__file__).parent / "files" / "metro.toml").read_text(encoding="utf-8")
EMU = (Path(vehicle.__file__).parent / "files" / "emu.toml").read_text(encoding="utf-8")


def edited(tmp_path: Path, changes: dict[str, str], text: str = METRO):
    for before, after in changes.items():
        assert text.count(before) == 1, before
        text = text.replace(before, after)
    path = tmp_path / "my.toml"
    path.write_text(text, encoding="utf-8")
    return path
