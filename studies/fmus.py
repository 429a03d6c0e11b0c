"""``python -m slipctl.studies.fmus``; see ``slipctl.studies.bench.fmus``."""

import sys

from slipctl.studies.bench.fmus import main

if __name__ == "__main__":
    sys.exit(main())
