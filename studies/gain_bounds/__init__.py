"""gain_bounds: the question in ``study``, what it needs beside it."""

from slipctl.studies.gain_bounds.study import study as study
