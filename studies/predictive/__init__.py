"""predictive: the question in ``study``, what it needs beside it."""

from slipctl.studies.predictive.study import study as study
