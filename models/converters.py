"""Converters of a test rig: digital to analog and back, with range, steps and noise.

The rig of Wang 2025 joins controller and train model by analog lines. The controller's force goes
out through a D/A converter, and what it measures comes in through A/D converters. The paper gives
neither bits nor ranges; 12 bit are what its kind of card has.

    code = round((u - lo)/q) in 0 .. 2^bits - 1,   q = (hi - lo)/(2^bits - 1),   y = lo + q code
"""

from casadi import floor, fmax, fmin

from slipctl import BadInput, Block, Input, Noise, Output, Param, law

GUESS = "guess, not in the paper"


def converter(
    unit: str,
    lo: float,
    hi: float,
    bits: int = 12,
    sigma: float = 0.0,
    positive: str | None = None,
    name: str = "converter",
) -> Block:
    """Make a converter, D/A or A/D; :func:`slipctl.replicate` makes it many.

    Args:
        unit: unit of the signal.
        lo, hi: range; what lies outside comes out as the end of the range.
        bits: of a code.
        sigma: standard deviation of the noise on the line before the conversion, in ``unit``.
        positive: sign convention of the signal.
        name: name of the block.

    Raises:
        BadInput: an empty range, or bits not from 1 to 32.
    """
    if not lo < hi:
        raise BadInput(f"{name}: range {lo:g} to {hi:g} {unit} is none; give lo < hi")
    if bits != int(bits) or not 1 <= bits <= 32:
        raise BadInput(f"{name}: bits = {bits} must be a whole number from 1 to 32")

    @law(
        y=Output(unit, "signal after the converter", lo=lo, hi=hi, positive=positive),
        full=Output("1", "1 while the signal is out of range, else 0"),
        name=name, choices={"bits": int(bits)},
    )  # fmt: skip
    def convert(
        u=Input(unit, "signal", positive=positive),
        n=Noise(),
        low=Param(unit, lo, "lower end of the range", GUESS, lo=-1e6, hi=1e6),
        high=Param(unit, hi, "upper end of the range", GUESS, lo=-1e6, hi=1e6),
        codes=Param("1", 2.0 ** int(bits) - 1, "largest code", f"{bits} bit", lo=1, hi=1e6),
        sigma=Param(
            unit, sigma, "noise before the conversion, standard deviation", GUESS, lo=0, hi=1e6
        ),
    ):
        """Converter with noise, saturation and steps; its error is at most half a step in range."""
        q = (high - low) / codes
        line = u + sigma * n
        code = floor((fmin(fmax(line, low), high) - low) / q + 0.5)
        return dict(y=low + q * code, full=(line < low) + (line > high))

    return convert


force_output = converter("N", -500e3, 350e3, positive="traction", name="force_output")
"""D/A of the commanded force; both limits of the train, 480 kN braking and 302 kN driving, fit."""

speed_input = converter("m/s", 0.0, 100.0, sigma=0.01, name="speed_input")
"""A/D of the train's speed: a step is 24 mm/s."""

wheel_input = converter("rad/s", 0.0, 225.0, sigma=0.02, name="wheel_input")
"""A/D of the speed of an axle: a step is 24 mm/s at the rim."""

torque_input = converter("N m", -8e3, 16e3, sigma=10.0, positive="traction", name="torque_input")
"""A/D of the torque of an axle: motors up to 13.4 kN m, brakes up to 6.7 kN m."""
