"""Super-twisting, which Huang 2020 and Wang 2025 share: what can be proved of it."""
