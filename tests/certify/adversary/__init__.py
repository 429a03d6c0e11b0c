"""Adversaries of certify: plain simulators that try to break every verdict, one file a system."""
