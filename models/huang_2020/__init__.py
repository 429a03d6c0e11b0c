"""Braked subway wheelset and its slip control; Huang, Du et al., Energies 2020."""
