"""Braked high-speed train and its slip control; Zhang, Peng et al., Actuators 2021."""
