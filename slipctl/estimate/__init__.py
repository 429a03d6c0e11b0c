"""What measurements say of a model: least squares, identification, fits, Kalman filters.

Does a line need data or measurements, online or from a file, to find parameters or states? Then it
lives here.
"""
