"""Certificates of Huang 2020: the sampled reaching law, alone and behind a lag; least squares."""
