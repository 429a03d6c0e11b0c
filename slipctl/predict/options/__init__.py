"""Is it something that a predictive controller may be asked for, and checks it?"""
