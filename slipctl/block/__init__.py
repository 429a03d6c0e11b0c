"""The Block and what is made of blocks alone.

Does a line declare signals, do the algebra of units, or make a block from nothing but blocks
(connect, discretise, replicate, adapt)? Then it lives here. It knows no data, no rail, no figure.
"""
