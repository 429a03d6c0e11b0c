"""Does it run a module on a processor, emulated or this one, tick by tick?"""
