"""Certificates of Cheng 2022: barrier Lyapunov control, and seeking the best slip."""
