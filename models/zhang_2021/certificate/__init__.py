"""Certificates of Zhang 2021: prescribed performance as sampled, and the adhesion filter."""
