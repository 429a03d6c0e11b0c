"""``python -m slipctl`` is the command line."""

import sys

from slipctl.commands.cli import main

if __name__ == "__main__":
    sys.exit(main())
