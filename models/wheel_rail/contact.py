"""Wheel on rail: Polach's creep law with falling friction; Wang et al., Appl. Sci. 2025, 15, 3909.

Signs: the creep v_s = v_w - v is the rim's speed minus the train's, so traction is positive.

    mu    = (2 mu_vf/pi) [k_A eps/(1 + (k_A eps)^2) + arctan(k_S eps)]          (6)
    eps   = (1/4) G pi a b c11/(Q mu_vf) s_x = (KEPS/mu_vf) s_x                 (6)
    mu_vf = mu_0 [(1 - A) exp(-B |v_s|) + A]                                    (7)
    s_x   = v_s/max(|v|, v_min)                                                 (8)

Q is the load of one wheel, a and b the semi-axes of its patch (models/wheel_rail/hertz.py). Odd in
v_s. Valid from standstill on: the floor v_min is added here, because (8) divides by zero there.
What is wrong in print is told in docs/errata.md; ``creep_law(form="printed-6")`` is as printed.
Friction falls to A mu_0 and no further, so a locked wheel brakes. The law was held against a
measured curve up to a creep of 2.5 m/s, that of the Eurosprinter in models/data.
"""

from __future__ import annotations

import logging
import math
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from casadi import atan, exp, fabs, fmax, pi

from slipctl import BadInput, Block, Input, Output, Param, argmax, argmax_table, law, make_block
from slipctl.analysis.optimum import Peak
from slipctl.errors import nearest
from slipctl.models.wheel_rail.hertz import E_STEEL, NU_STEEL, c11, ellipse
from slipctl.tables.table import read_table

log = logging.getLogger("slipctl")

TABLE_3 = "Wang 2025, Table 3"
GUESS = "guess, not in the paper"
WHEEL_LOAD = 15625.0 * 9.8 / 2
"""Load of one wheel in N: 500 t on 64 wheels."""

SURFACES = {
    "dry": {"k_A": 1.0, "k_S": 0.45, "A": 0.36, "B": 0.55, "mu_0": 0.47},
    "damp": {"k_A": 0.35, "k_S": 0.29, "A": 0.45, "B": 0.30, "mu_0": 0.30},
    "wet": {"k_A": 0.28, "k_S": 0.14, "A": 0.40, "B": 0.24, "mu_0": 0.128},
    "oily": {"k_A": 0.25, "k_S": 0.10, "A": 0.40, "B": 0.20, "mu_0": 0.13},
    "ice": {"k_A": 0.23, "k_S": 0.08, "A": 0.35, "B": 0.20, "mu_0": 0.073},
}
"""Table 3. It is no order of quality: below 5 m/s wet rail has less adhesion than oily rail."""

PARAMETERS = ("k_A", "k_S", "A", "B", "mu_0")
"""What a surface sets."""
Surfaces = Mapping[str, Mapping[str, float]]
FORMS = ("consistent", "printed-6", "printed-7", "printed-8")


def patch(
    Q: float = WHEEL_LOAD,
    R_wheel: float = 0.445,
    R_rail: float = 0.300,
    E: float = E_STEEL,
    nu: float = NU_STEEL,
    nu_c11: float = 0.25,
) -> dict[str, float]:
    """Parameters of the law for a conical wheel on a rail head, by Hertz and Kalker.

    Args:
        Q: load of the wheel in N.
        R_wheel, R_rail: radii in m of the wheel in rolling direction and of the rail head across.
        E, nu: of the steel, in Pa and 1.
        nu_c11: Poisson's ratio at which Kalker's table is read. Its own column 0.25 is the usual
            one for steel; 0.28 makes c11 and KEPS 2.4 % larger.

    Returns:
        ``{"Q", "G", "a", "b", "c11"}``, for ``polach.with_params(**patch(...))``.

    Raises:
        BadInput: a quantity is not positive, or the ellipse is outside Kalker's table.
    """
    for name, R in (("R_wheel", R_wheel), ("R_rail", R_rail)):
        if not R > 0:
            raise BadInput(f"patch: {name} = {R:g} m must be positive")
    shape = ellipse(Q, 1 / (2 * R_wheel), 1 / (2 * R_rail), E, nu)
    G = E / (2 * (1 + nu))
    return {"Q": Q, "G": G, "a": shape.a, "b": shape.b, "c11": c11(shape.a / shape.b, nu_c11)}


_PATCH = patch()

FITS = 0.01
"""Share by which what belongs to a wheel may be off: roundings of a table."""


def check_patch(p: Mapping[str, Any], load: Any, r: Any) -> None:
    """Refuse a contact that is the one of another wheel: its load, or the patch of its load.

    A patch with numbers of its own (measured, fitted, of another rail head) is taken as it is.

    Args:
        p: numbers of the law; one without a patch is not judged.
        load: what the wheel carries in N, of each axle.
        r: radius of the wheel in m, of each axle.

    Raises:
        BadInput: with both loads, and what to write.
    """
    if not {"Q", "a", "b", "c11"} <= set(p):
        return
    load, r, Q = (np.ravel(np.asarray(v, dtype=float)) for v in (load, r, p["Q"]))
    as_made = all(np.all(np.asarray(p[n]) == _PATCH[n]) for n in ("a", "b", "c11"))
    for N, R, q in np.unique(np.column_stack(np.broadcast_arrays(load, r, Q)), axis=0):
        if abs(q / N - 1) <= FITS and not as_made:
            continue
        fits = patch(N, R)
        numbers = f"a={fits['a']:.4g}m b={fits['b']:.4g}m c11={fits['c11']:.4g}"
        if abs(q / N - 1) > FITS:
            raise BadInput(
                f"Q = {q:.4g} N is the load of another wheel, this one carries {N:.4g} N: set"
                f" Q={N:.5g}N, and its patch by Hertz and Kalker for r = {R:.3g} m, {numbers}"
            )
        if max(abs(fits[n] / _PATCH[n] - 1) for n in ("a", "b", "c11")) > FITS:
            raise BadInput(
                f"a, b and c11 are of a wheel with {_PATCH['Q']:.4g} N; at {N:.4g} N and"
                f" r = {R:.3g} m they are others by Hertz and Kalker: set {numbers} too"
            )


def law_of_wheel(law_: Block, load: float, r: float, wheels: int) -> Block:
    """Law whose patch is the one of a vehicle's wheel, and follows the mass of the vehicle.

    By Hertz both semi-axes grow with the third root of the load; their ratio, and c11, stay.

    Args:
        law_: with the numbers of another wheel. One without a patch, or with a patch of its own
            (measured, fitted), is given back as it is.
        load: of a wheel in N. r: its radius in m. wheels: of the vehicle, which carry alike.
    """
    own = ("Q", "a", "b", "c11")
    params = law_.params
    if not set(own) <= set(params) or any(
        params[n].derived or params[n].value != _PATCH[n] for n in own
    ):
        return law_
    fits = patch(load, r)
    texts = {"Q": f"m * g / {wheels}"} | {
        n: f"{fits[n]!r} * (Q / {load!r}) ** (1 / 3)" for n in ("a", "b")
    }
    signals = [replace(s, value=texts[n]) if n in texts else s for n, s in params.items()]
    c11_at = next(k for k, s in enumerate(signals) if s.name == "c11")
    signals[c11_at] = replace(signals[c11_at], value=fits["c11"])
    signals += [
        Param("kg", load * wheels / 9.81, "vehicle", "of the vehicle", lo=100, hi=1e8).named("m"),
        Param("m/s^2", 9.81, "gravity", "of the vehicle").named("g"),
    ]

    def body(x: dict[str, Any], u: dict[str, Any], p: dict[str, Any]) -> Any:
        return law_.expr(x, u, {n: p[n] for n in params})

    return make_block(
        law_.name, "law", body, inputs=law_.inputs.values(), params=signals,
        outputs=law_.outputs.values(), conditions=law_.conditions, law_data=law_.law_data,
        choices=law_.choices, sx=law_.sx, doc=law_.doc,
    )  # fmt: skip


def patch_of_curve(
    Q: float, G: float, R_wheel: float, R_rail: float, nu_c11: float
) -> dict[str, float]:
    """Semi-axes and c11 of the wheel of a measured curve; what a fit takes in place of another's.

    Args:
        Q: load of the wheel in N.
        G: shear modulus in Pa.
        R_wheel, R_rail, nu_c11: as of :func:`patch`.
    """
    found = patch(Q, R_wheel, R_rail, 2 * G * (1 + NU_STEEL), NU_STEEL, nu_c11)
    return {n: found[n] for n in ("a", "b", "c11")}


BESIDE = {
    "R_wheel": Param("m", 0.445, "radius of the wheel", GUESS, lo=0.05, hi=5),
    "R_rail": Param("m", 0.3, "radius of the rail head, across", GUESS, lo=0.02, hi=1e3),
    "nu_c11": Param("1", 0.25, "Poisson's ratio at which c11 is read", GUESS, lo=0, hi=0.5),
}
"""What a fit may be told beside the parameters of the law, for :func:`patch_of_curve`."""

LEFT_OUT = (
    "the tractions on the patch (FASTSIM: fastsim; a line: carter; exactly: CONTACT), spin and"
    " lateral creep, an elastic layer on the rail, heat"
)


@law(
    mu=Output("1", "adhesion coefficient", positive="traction"),
    conditions=SURFACES,
    readings={"v_s": "creep * v", "mu": "force / Q"},
    expects=("k_A >= k_S",),
    follows=patch_of_curve,
    beside=BESIDE,
    leaves_out=LEFT_OUT,
    measured_to=2.5,
    meant_to=math.inf,
)
def polach(
    v_s=Input("m/s", "creep, rim minus train", positive="traction", per="speed"),
    v=Input("m/s", "train speed"),
    k_A=Param("1", 1.0, "share of the area of adhesion", f"{TABLE_3}, dry", lo=1e-4, hi=100),
    k_S=Param("1", 0.45, "share of the area of slip", f"{TABLE_3}, dry", lo=1e-4, hi=100),
    A=Param("1", 0.36, "friction at high creep by that at none", f"{TABLE_3}, dry", lo=0, hi=1),
    B=Param("s/m", 0.55, "decay of the friction", f"{TABLE_3}, dry", lo=1e-3, hi=10),
    mu_0=Param("1", 0.47, "friction without creep", f"{TABLE_3}, dry", lo=1e-3, hi=1),
    Q=Param("N", _PATCH["Q"], "load of the wheel", "Wang 2025, Table 1", lo=1e3, hi=1e6),
    G=Param("Pa", _PATCH["G"], "shear modulus", GUESS, lo=1e8, hi=1e12),
    a=Param("m", _PATCH["a"], "semi-axis of the patch, rolling", "Hertz", lo=1e-4, hi=0.1),
    b=Param("m", _PATCH["b"], "semi-axis of the patch, lateral", "Hertz", lo=1e-4, hi=0.1),
    c11=Param("1", _PATCH["c11"], "creep coefficient", "Kalker 1990, Table E.3", lo=1, hi=50),
    KEPS=Param("1", "G * pi * a * b * c11 / (4 * Q)", "stiffness by load", "eq (6)", lo=0, hi=1e6),
    v_min=Param("m/s", 1.0, "speed below which the creep is not divided", GUESS, lo=1e-3, hi=10),
):
    """Adhesion over creep after Polach, with friction that falls; Wang 2025 eqs (6)-(8)."""
    mu_vf = mu_0 * ((1 - A) * exp(-B * fabs(v_s)) + A)
    eps = KEPS / mu_vf * v_s / fmax(fabs(v), v_min)
    return 2 * mu_vf / pi * (k_A * eps / (1 + (k_A * eps) ** 2) + atan(k_S * eps))


def creep_law(form: str = "consistent", surfaces: Surfaces = SURFACES) -> Block:
    """Make Polach's law in another form or on other surfaces.

    Args:
        form: ``"consistent"``; ``"printed-6"`` with 1 + k_A eps^2, ``"printed-7"`` with
            exp(-B v_s), which grows in braking, ``"printed-8"`` with v_s = v - v_w, so that
            traction has negative adhesion (docs/errata.md).
        surfaces: parameters by name of the surface, as :func:`read_surfaces` gives them.

    Raises:
        BadInput: unknown form, or a surface with a parameter that is unknown, missing or off range.
    """
    if form not in FORMS:
        raise BadInput(f"creep_law has no form {form!r}; it has {', '.join(FORMS)}")
    for name, values in surfaces.items():
        _check_surface(f"surface {name}", values)

    def body(x: dict[str, Any], u: dict[str, Any], p: dict[str, Any]) -> Any:
        if form == "consistent":
            return polach.expr(x, u, p)
        if form == "printed-8":
            return polach.expr(x, u | {"v_s": -u["v_s"]}, p)
        v_s, v, k_A = u["v_s"], u["v"], p["k_A"]
        falling = exp(-p["B"] * (v_s if form == "printed-7" else fabs(v_s)))
        mu_vf = p["mu_0"] * ((1 - p["A"]) * falling + p["A"])
        eps = p["KEPS"] / mu_vf * v_s / fmax(fabs(v), p["v_min"])
        square = k_A * eps**2 if form == "printed-6" else (k_A * eps) ** 2
        grip = k_A * eps / (1 + square) + atan(p["k_S"] * eps)
        return {}, {"mu": 2 * mu_vf / pi * grip}

    return make_block(
        "polach", "law", body, inputs=polach.inputs.values(), params=polach.params.values(),
        outputs=polach.outputs.values(), conditions=surfaces, law_data=polach.law_data,
        choices={} if form == "consistent" else {"form": form}, doc=polach.doc,
    )  # fmt: skip


def read_surfaces(path: str | Path) -> dict[str, dict[str, float]]:
    """Surfaces from a table ``surface,k_A,k_S,A,B,mu_0``, one row each; B in s/m.

    Raises:
        BadInput: no such file, another head, a row with a wrong number of columns, or a value that
            is no number or off range.
    """
    table = read_table(path)
    wanted = ["surface", *PARAMETERS]
    if table.names != wanted:
        raise BadInput(
            f"{path} has the columns {', '.join(table.names)}; a surface table has"
            f" {', '.join(wanted)}"
        )
    found: dict[str, dict[str, float]] = {}
    numbers = [table.numbers(n) for n in PARAMETERS]
    for line, name, *values in zip(table.lines, table.cells["surface"], *numbers, strict=True):
        if not name.isidentifier() or name in found:
            raise BadInput(f"{path}, line {line}: {name!r} is no name, or the second of its kind")
        found[name] = dict(zip(PARAMETERS, map(float, values), strict=True))
        _check_surface(f"{path}, line {line}", found[name])
    return found


def _check_surface(where: str, values: Mapping[str, float]) -> None:
    """Refuse a surface that the law cannot have; warn of k_A < k_S."""
    for name in PARAMETERS:
        if name not in values:
            raise BadInput(f"{where} lacks {name}; a surface has {', '.join(PARAMETERS)}")
    for name, value in values.items():
        if name not in polach.params:
            raise BadInput(f"{where}: there is no parameter {name!r}{nearest(name, PARAMETERS)}")
        polach.params[name].check(f"{where}: {name}", value)
    if values["k_A"] < values["k_S"]:
        log.warning("%s: k_A = %g < k_S = %g; Polach asks for k_A >= k_S", where,
                    values["k_A"], values["k_S"])  # fmt: skip


def _numbers_of(surface: str | Mapping[str, float], adhesion: Block) -> Mapping[str, float]:
    """Parameters of a surface by its name, or those that are given."""
    if not isinstance(surface, str):
        return surface
    if surface not in adhesion.conditions:
        near = nearest(surface, adhesion.conditions)
        raise BadInput(f"{adhesion.name} has no surface {surface!r}{near}")
    return adhesion.conditions[surface]


def peak(
    v: float,
    surface: str | Mapping[str, float] = "dry",
    adhesion: Block = polach,
    proven: bool = False,
) -> Peak:
    """Creep in m/s (``location``) and value of the largest adhesion in traction, at speed v.

    Args:
        v: train speed in m/s.
        surface: a name of the law's conditions, or parameters by name.
        adhesion: law from ``v_s`` and ``v`` to ``mu``.
        proven: prove that there is no other peak up to 20 m/s or v, which takes half a second.

    Raises:
        BadInput: unknown surface or parameter.
    """
    at = {"v": v, **_numbers_of(surface, adhesion)}
    return argmax(adhesion, "v_s", "mu", lo=0.0, hi=max(20.0, abs(v)), at=at, proven=proven)


def peak_table(adhesion: Block = polach, fastest: float = 90.0, error: float = 1e-3) -> Block:
    """Law from ``v`` to the best creep and the largest adhesion on each surface, for C.

    Args:
        adhesion: law from ``v_s`` and ``v`` to ``mu``, with its surfaces.
        fastest: train speed in m/s up to which it holds.
        error: relative error of both.
    """
    return argmax_table(adhesion, "v_s", "v", "mu", lo=0.0, hi=20.0, span=(0.0, fastest),
                        error=error)  # fmt: skip


def curtius_kniffler(v: float) -> float:
    """Adhesion that a locomotive may count on at v in m/s: 7.5/(V + 44) + 0.161, V in km/h.

    Curtius and Kniffler, Elektrische Bahnen 20 (1944); measured on dry rail up to 160 km/h.
    """
    return 7.5 / (3.6 * abs(v) + 44) + 0.161


def slope(surface: str | Mapping[str, float] = "dry", adhesion: Block = polach) -> float:
    """Slope d mu/d s_x without creep: (2/pi) (k_A + k_S) KEPS, whatever the friction.

    Raises:
        BadInput: unknown surface or parameter.
    """
    p = adhesion.param_values(**_numbers_of(surface, adhesion))
    return 2 / math.pi * float(p["k_A"] + p["k_S"]) * float(p["KEPS"])
