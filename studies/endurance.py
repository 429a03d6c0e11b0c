"""``python -m slipctl.studies.endurance``; see ``slipctl.studies.bench.endurance``."""

import sys

from slipctl.studies.bench.endurance import main

if __name__ == "__main__":
    sys.exit(main())
