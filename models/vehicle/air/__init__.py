"""Air brakes: cylinders behind valves, bits from a torque, slide protection as a state machine."""
