"""Does it turn a CasADi Function into expressions and statements of C?"""
