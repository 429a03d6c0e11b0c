"""freight_traction: the question in ``study``, what it needs beside it."""

from slipctl.studies.freight_traction.study import study as study
