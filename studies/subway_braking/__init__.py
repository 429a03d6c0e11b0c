"""subway_braking: the question in ``study``, what it needs beside it."""

from slipctl.studies.subway_braking.study import study as study
