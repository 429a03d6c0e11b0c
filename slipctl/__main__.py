"""``python -m slipctl`` is the command line."""

import sys

from slipctl.commands.cli import program

if __name__ == "__main__":
    sys.exit(program())
