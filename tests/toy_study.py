"""A toy: does the soft controller slip less than the hard one?"""

from collections.abc import Mapping
from typing import Any

from casadi import exp, fmax, fmin, sign

from slipctl import (
    Block,
    Case,
    Claim,
    Context,
    Experiment,
    Figure,
    Input,
    Known,
    Noise,
    Output,
    Param,
    Rail,
    Results,
    Scenario,
    Section,
    Signals,
    State,
    Study,
    Table,
    connect,
    flow,
    law,
    sampled,
    simulate,
    step,
)

RAILS = {"dry": {"c": 1.0}, "ice": {"c": 0.1}}


@law(mu=Output("1", "adhesion coefficient", positive="braking"), conditions=RAILS)
def adhesion(
    s=Input("m/s", "slip speed", positive="braking", per="speed"),
    c=Param("1", 1.0, "height", "Toy, Table 1", lo=0.01, hi=2),
    a=Param("s/m", 0.5, "slow decay", "Toy, Table 1", lo=0.1, hi=2),
):
    """Toy adhesion, mu = c (exp(-a s) - exp(-2 a s))."""
    return c * (exp(-a * s) - exp(-2 * a * s))


@flow(s=Output("m/s", "slip speed", positive="braking", per="speed"),
      d=Output("m/s^2", "deceleration", positive="braking"))  # fmt: skip
def car(
    x=State("m", 0.0, "position"),
    v=State("m/s", 20.0, "speed"),
    rim=State("m/s", "v", "rim speed"),
    T_b=Input("N m", "brake torque", positive="braking"),
    mu=Input("1", "adhesion coefficient", positive="braking"),
    m=Param("kg", 8000.0, "mass", "Toy, Table 2", lo=1000, hi=40000),
    J=Param("kg m^2", 240.0, "inertia", "Toy, Table 2", lo=1),
    r=Param("m", 0.5, "radius", "Toy, Table 2", lo=0.2, hi=1),
    g=Param("m/s^2", 9.81, "gravity"),
):
    """Toy car on one wheel."""
    d = mu * g
    return dict(x=v, v=-d, rim=r * (r * mu * m * g - T_b) / J), dict(s=v - rim, d=d)


@law(s_m=Output("m/s", "measured slip", positive="braking", per="speed"))
def sensor(
    s=Input("m/s", "slip speed", positive="braking", per="speed"),
    n=Noise(),
    sigma=Param("m/s", 0.01, "noise", lo=0),
):
    """Noisy slip sensor."""
    return s + sigma * n


def controller(kind: str = "soft") -> Block:
    """Make the soft or the hard controller."""

    @step(T_b=Output("N m", "torque", positive="braking"), name="ctl", choices={"kind": kind})
    def ctl(
        integral=State("N m", 3000.0, "integral of the error"),
        s=Input("m/s", "slip", positive="braking", per="speed"),
        s_ref=Input("m/s", "wanted slip", positive="braking", per="speed"),
        K=Param("N s", 4000.0, "gain", "chosen", lo=0),
        k=Param("N", 40000.0, "integral gain", "chosen", lo=0),
        h=Param("s", 1e-3, "tick", lo=1e-6),
    ):
        """Toy controller."""
        e = s_ref - s
        nudge = e if kind == "soft" else sign(e)
        T = fmin(20e3, fmax(0, integral + K * nudge))
        return dict(integral=integral + h * k * e), dict(T_b=T)

    return ctl


def loop(adh: Block, ctl: Block) -> Block:
    """Connect the toy loop."""
    plant = connect("plant", {"adh.s": "car.s", "car.mu": "adh.mu"}, car=car, adh=adh)
    return connect(
        "loop",
        {
            "plant.car.T_b": "ctl.T_b", "meter.s": "plant.car.s", "ctl.s": "meter.s_m",
            "ctl.s_ref": "s_ref",
        },
        plant=sampled(plant, 1e-3, "rk4", substeps=2), meter=sensor, ctl=ctl,
    )  # fmt: skip


def cases(models: Mapping[str, Any], quick: bool) -> list[Case]:
    """Two scenarios."""
    T = 0.6 if quick else 1.2
    rail = Rail([Section(0, "dry"), Section(T / 2, "ice")])
    known = {"rail.best_adhesion": Known("1", [0.25, 0.025], "peak of the adhesion")}
    loops = {
        "soft": loop(models["adh"], controller()),
        "hard": loop(models["adh"], controller("hard")),
    }
    base = Scenario("base", T, rail, inputs={"s_ref": 1.3}, noise=0.0, doc="No noise.")
    noisy = Scenario("noisy", T, rail, inputs={"s_ref": 1.3}, start={"car.v": 18.0}, seed=7)
    return [Case(base, loops, known), Case(noisy, {"soft": loops["soft"]}, known)]


def seeds(context: Context) -> Table:
    """Slip error over seeds."""
    block, scenario = context.loop("noisy", "soft")
    count = 2 if context.quick else 4
    worst = []
    for seed in range(1, count + 1):
        data = simulate(block, scenario.but(seed=seed), compile=context.compile)
        worst.append(float(abs(data["plant.car.s"] - 1.3)[-100:].max()))
        context.progress(seed / count)
    return Table(
        "Worst error at the end", {"seed": ("1", range(1, count + 1)), "e": ("m/s", worst)}
    )


def slip(results: Results) -> Any:
    """Slip and torque."""
    from slipctl.draw import plots

    return plots.traces(results, "base", signals=[("slip", "reference"), "torque"])


study = Study(
    name="toy",
    title="A toy of two controllers",
    source="Nobody 2000",
    doc="Does the soft controller slip less than the hard one?",
    models={"adh": adhesion},
    cases=cases,
    signals=Signals(
        speed="plant.car.v", position="plant.car.x", slip="plant.car.s", reference="s_ref",
        adhesion="plant.adh.mu", best_adhesion="rail.best_adhesion", torque="ctl.T_b",
        deceleration="plant.car.d",
    ),
    experiments={"seeds": Experiment("Many seeds", seeds, "How bad can it be?")},
    claims=(
        Claim("ripple", "Fig. 1", "the soft torque is smoother", "order", "hard > soft",
              lambda r: {n: r.metric("base", n, "torque_ripple") for n in ("soft", "hard")},
              "N m", scenario="base"),
        Claim("way", "Table 3", "way of the soft one", "number", "15.00",
              lambda r: r.metric("base", "soft", "distance"), "m", "last digit",
              scenario="base", loop="soft", assumption="20 m/s at the start"),
        Claim("gone", "section 4", "cannot be known", "number", 3,
              not_checkable="the paper gives no data"),
        Claim("use", "abstract", "uses all adhesion", "yes/no", True,
              lambda r: r.metric("noisy", "soft", "adhesion_use") > 0.99),
    ),
    figures={"fig01": Figure("Slip of both.", slip, "Fig. 1")},
)  # fmt: skip
