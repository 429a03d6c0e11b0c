"""Which certificates a loop has."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from slipctl.errors import BadInput

if TYPE_CHECKING:
    from slipctl.study.declaration import Gains
    from slipctl.workbench.desk import Rig


def certificates_of_rig(rig: Rig) -> dict[str, Any]:
    """Which certificates can be asked for of a loop, or why there is none."""
    why = rig.study.certificates.uncertified.get(rig.name, "")
    if not rig.gains and not why:
        why = "the study declares no gains of this loop to certify"
    return {"names": [g.name for g in rig.gains], "why": why}


def gains_by_name(rig: Rig, name: str = "") -> Gains:
    """Certificate of a loop by its name; the first one without.

    Raises:
        BadInput: it has none; says why.
    """
    found = next((g for g in rig.gains if name in ("", g.name)), None)
    if found is None:
        raise BadInput(f"{rig.name} has no certificate{f' {name!r}' if name else ''}:"
                       f" {certificates_of_rig(rig)['why'] or 'choose another'}")  # fmt: skip
    return found
