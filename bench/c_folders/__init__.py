"""Folders of C that are written and judged: what they are, their proofs, how far they reach."""
