"""Certificates: a promise that a reader can check with rationals alone.

A certificate holds all that was asked, as exact rationals, the promise in words, and proofs or a
counterexample. ``check`` repeats them from these numbers, without the search that found them. A
file that was changed anywhere fails, or states a promise that ``check`` has proved anew.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from fractions import Fraction
from typing import Any

from slipctl import registry
from slipctl.certify import catalogue, proofs
from slipctl.certify.entries import DoesNotHold, brief
from slipctl.certify.proofs import FORMAT, KIND
from slipctl.errors import BadInput

__all__ = ["FORMAT", "KIND", "Certificate", "DoesNotHold", "certificate_of", "check"]


@dataclass(frozen=True)
class Certificate:
    """What a certificate of a system holds.

    Attributes:
        entries: entries of the file.
    """

    entries: Mapping[str, Any]

    def _repr_html_(self) -> str:
        return registry.view(self, "html")

    @property
    def verdict(self) -> str:
        """CERTIFIED, REFUTED or UNDECIDED."""
        return str(self.entries["verdict"])

    def payload(self) -> dict[str, Any]:
        """Entries of the file."""
        return dict(self.entries)


def certificate_of(name: str, **numbers: float | Fraction) -> Certificate:
    """Certificate of a system: ``certificate_of("lagged_loop", K=1, T=1)``.

    Args:
        name: of the system.
        numbers: fractions are taken as they are, floats by their exact binary value.

    Raises:
        BadInput: an unknown system, or numbers that mean nothing.
    """
    return Certificate(proofs.write(catalogue.system(name), numbers))


def check(payload: Mapping[str, Any]) -> str:
    """Check a certificate; gives what it proves, in one line.

    Raises:
        DoesNotHold: a proof fails, or its numbers do not belong to what was asked.
        BadInput: it is no certificate of a system that is known, or an entry is no number.
    """
    if not isinstance(payload, Mapping) or payload.get("kind") != KIND:
        raise BadInput("it is no certificate; slipctl certify ... --out FILE writes one")
    found = payload.get("format")
    if isinstance(found, bool) or not isinstance(found, int) or found < 1:
        raise BadInput(f"its format is {brief(found)}, it must be {FORMAT}")
    if found > FORMAT:
        raise BadInput(f"it has format {brief(found)}, this slipctl reads {FORMAT}; update slipctl")
    if found < FORMAT:
        raise BadInput(
            f"it has format {found}, which leaves out what its proofs did not use, so that its"
            " verdict may say more than was proved; write it again with slipctl certify ... --out"
        )
    name = payload.get("system")
    if isinstance(name, str) and name in catalogue.OF_LOOPS:
        return proofs.check(catalogue.OF_LOOPS[name], payload)
    if not isinstance(name, str) or name not in catalogue.SYSTEMS:
        known = ", ".join(catalogue.SYSTEMS)
        raise BadInput(f"no check for the system {brief(name)}; it has {known}")
    return proofs.check(catalogue.SYSTEMS[name], payload)
