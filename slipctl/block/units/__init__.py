"""Does it do the algebra of units?"""
