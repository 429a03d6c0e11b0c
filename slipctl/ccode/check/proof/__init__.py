"""Does it prove something of the C, or read what the prover says?"""
