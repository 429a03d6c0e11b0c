"""Certificates of super-twisting: continuous, as sampled, late, in implicit steps."""
