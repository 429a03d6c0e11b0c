"""``slipctl check``: a certificate again."""

from __future__ import annotations

import argparse

from slipctl.commands import certify


def answer(options: argparse.Namespace, command: str) -> int:
    """Print what the certificate proves."""
    print(certify.check(options.file))
    return 0
