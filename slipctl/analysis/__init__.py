"""What a block says of itself: slopes, operating points, peaks, bounds.

Does a line ask a block a question that its equations alone answer (a Jacobian, a linear model, an
equilibrium, a peak, an observer's gain)? Then it lives here.
"""
