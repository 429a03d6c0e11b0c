"""leaf_fall: the question in ``study``, what it needs beside it."""

from slipctl.studies.leaf_fall.study import study as study
