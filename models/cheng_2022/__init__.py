"""Driven freight train and its creep control; Cheng, He et al., JESA 55(2), 2022."""
