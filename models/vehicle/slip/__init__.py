"""Slip control of an axle beside its law: when it takes over, and a PI law with scheduled gains."""
