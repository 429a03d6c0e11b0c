"""``python -m slipctl.studies.speed``; see ``slipctl.studies.bench.speed``."""

import sys

from slipctl.studies.bench.speed import main

if __name__ == "__main__":
    sys.exit(main())
