"""hst_traction: the question in ``study``, what it needs beside it."""

from slipctl.studies.hst_traction.study import study as study
