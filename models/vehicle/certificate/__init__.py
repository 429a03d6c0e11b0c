"""What certify asks of a vehicle file: its bounds, its gains, a short axle for its controllers."""
