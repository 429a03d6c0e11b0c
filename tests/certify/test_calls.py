"""No function of the room gives another number than it gave; see ``recorded_calls``.

Who changes a number on purpose: ``python tests/draw_calls.py slipctl/certify --again``.
"""

from __future__ import annotations

import pytest
import recorded_calls

pytestmark = pytest.mark.table  # left out unless asked for: pytest -m table

ROOM = "slipctl/certify"
PLACES = sorted({place.split(":")[0] for place in recorded_calls.read(ROOM)})


@pytest.mark.parametrize("module", PLACES)
def test_calls_give_what_they_gave(module: str) -> None:
    assert not recorded_calls.changed(ROOM, module)
