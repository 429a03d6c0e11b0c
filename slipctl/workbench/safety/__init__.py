"""How safe is it: which certificates, regions of gains and worst runs has a loop?"""
