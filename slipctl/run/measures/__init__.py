"""What is measured of a run: the run as metrics see it, and metrics of sliding wheels."""
