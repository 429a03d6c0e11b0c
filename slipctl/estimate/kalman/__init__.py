"""Kalman filters of a flow: unscented and extended, made by ``ctukf`` and ``ekf``.

Does a line belong to the filter of states (its model, its moments, its forms, its signals)? Then
it lives here.
"""
