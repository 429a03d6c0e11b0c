"""``python -m slipctl.studies.c_targets``; see ``slipctl.studies.bench.c_targets``."""

import sys

from slipctl.studies.bench.c_targets import main

if __name__ == "__main__":
    sys.exit(main())
