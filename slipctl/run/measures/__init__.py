"""How is a run measured: what do metrics see of it, and what of sliding wheels?"""
