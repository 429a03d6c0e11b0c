"""Loops whose controller is its C: with wrong samples, and over very many steps."""
