"""all_rails: the question in ``study``, what it needs beside it."""

from slipctl.studies.all_rails.study import study as study
