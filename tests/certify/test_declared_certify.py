"""Defaults, fields and constants of this room change on purpose only.

``python tests/certify/test_declared_certify.py`` writes the table anew.
"""

import sys
from pathlib import Path

if __name__ == "__main__":
    sys.path[:0] = [str(Path(__file__).parents[1])]

from declared import changed, write

TABLE = Path(__file__).parent / "declared.csv"


def test_what_is_declared_is_what_the_table_says():
    assert changed("slipctl.certify", TABLE) == []


if __name__ == "__main__":
    write("slipctl.certify", TABLE)
