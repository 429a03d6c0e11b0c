"""Does it say why the numbers of a run may be doubted?"""
