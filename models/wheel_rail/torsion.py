"""A wheelset that twists: where falling adhesion makes its axle swing, and how hard.

Inertias J_i are joined by shafts k_j; some of them are wheels of radius r that carry N each. With
the mode psi of unit modal mass, frequency w and damping ratio z, linearised at a slip speed s,

    q'' + (2 z w + sum_wheels N r^2 f'(s) psi^2) q' + w^2 q = 0

so a mode grows where  -f' > 2 z w/(sum_wheels N r^2 psi^2).  Two equal wheels on an axle of
stiffness k have w = sqrt(2 k/J) and the critical fall 2 z sqrt(2 k J)/(N r^2). In the limit cycle a
wheel swings between sticking and twice its slip, so the torque of the axle comes near

    s sqrt(2 k J)/r

Inertias and damping of a vehicle are its maker's; stiffness follows from the axle's geometry.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import pi
from typing import Any

import numpy as np

from slipctl import BadInput, Block, Input, Output, Param, State, make_block
from slipctl.errors import check_positive

SHEAR_MODULUS = 79.3e9
"""Of axle steel, in Pa."""

USER = "of the vehicle; no published table could be read"


def axle_stiffness(diameter: float, length: float, G: float = SHEAR_MODULUS) -> float:
    """Stiffness G pi d^4/(32 L) in N m/rad of a solid axle, of its diameter and length in m."""
    for name, value in (("diameter", diameter), ("length", length), ("G", G)):
        check_positive(f"axle_stiffness: {name}", value)
    return G * pi * diameter**4 / (32 * length)


@dataclass(frozen=True)
class Mode:
    """A mode of a wheelset.

    Attributes:
        frequency: in Hz.
        critical_fall: fall of the adhesion over slip speed in s/m beyond which it grows; infinity
            where no wheel takes part in it.
        shape: of each inertia, of unit modal mass, in 1/sqrt(kg m^2).
    """

    frequency: float
    critical_fall: float
    shape: np.ndarray


@dataclass(frozen=True)
class Wheelset:
    """Inertias in a row and the shafts between them.

    Attributes:
        inertias: in kg m^2, one behind the other: wheel and wheel, or rotor, wheel, wheel.
        stiffness: of each shaft in N m/rad, one fewer.
        wheels: places of the wheels among the inertias.
        load: of a wheel in N.
        radius: of the wheels in m.
        damping: ratio of each mode.
    """

    inertias: Sequence[float]
    stiffness: Sequence[float]
    wheels: Sequence[int]
    load: float
    radius: float
    damping: float = 0.005

    def __post_init__(self) -> None:
        if len(self.inertias) < 2 or len(self.stiffness) != len(self.inertias) - 1:
            raise BadInput("a wheelset has two inertias or more and a shaft between each two")
        for name in ("inertias", "stiffness"):
            for value in getattr(self, name):
                check_positive(f"wheelset: {name}", value)
        for name in ("load", "radius", "damping"):
            check_positive(f"wheelset: {name}", getattr(self, name))
        if not self.wheels or any(not 0 <= k < len(self.inertias) for k in self.wheels):
            raise BadInput("wheels of a wheelset are places among its inertias, from 0")

    @property
    def stiffness_matrix(self) -> np.ndarray:
        """Stiffness over the angles of the inertias, in N m/rad."""
        n = len(self.inertias)
        K = np.zeros((n, n))
        for j, k in enumerate(self.stiffness):
            K[j : j + 2, j : j + 2] += k * np.array([[1.0, -1.0], [-1.0, 1.0]])
        return K

    def modes(self) -> list[Mode]:
        """Modes in which it twists, by frequency."""
        from scipy.linalg import eigh

        squares, shapes = eigh(self.stiffness_matrix, np.diag(self.inertias))
        found = []
        for square, shape in zip(squares[1:], shapes.T[1:], strict=True):  # the first one turns
            w = float(np.sqrt(square))
            drive = self.load * self.radius**2 * float((shape[list(self.wheels)] ** 2).sum())
            fall = 2 * self.damping * w / drive if drive > 0 else np.inf
            found.append(Mode(w / (2 * pi), fall, shape))
        return found

    @property
    def critical_fall(self) -> float:
        """Fall of the adhesion over slip speed in s/m beyond which a mode grows."""
        return min(m.critical_fall for m in self.modes())


def twisting_axle(adhesion: Block) -> Block:
    """Make the flow of two equal wheels whose mean speed is held, from ``v`` and ``s`` to torque.

    J p'' + 2 d p' + 2 k p + r N (f(s + r p'/2) - f(s - r p'/2)) = 0, with the twist p and the mean
    slip speed s, traction positive.

    Args:
        adhesion: law from ``v_s`` and ``v`` to ``mu``, traction positive.
    """
    laws = [p for p in adhesion.params.values() if not p.derived]

    def body(x: Any, u: Any, p: Any) -> Any:
        swing = p["r"] * x["rate"] / 2
        own = adhesion.derive({k.name: p[k.name] for k in laws})

        def height(s: Any) -> Any:
            return adhesion.expr({}, {"v_s": s, "v": u["v"]}, own)[1]["mu"]

        pull = p["r"] * p["N"] * (height(u["s"] + swing) - height(u["s"] - swing))
        torque = p["k"] * x["twist"]
        return (
            {"twist": x["rate"], "rate": -(2 * torque + 2 * p["d"] * x["rate"] + pull) / p["J"]},
            {"torque": torque, "slip": u["s"] + swing, "mu": height(u["s"] + swing)},
        )

    return make_block(
        "axle", "flow", body,
        states=[State("rad", 0.0, "twist of the axle").named("twist"),
                State("rad/s", 1e-3, "its rate").named("rate")],
        inputs=[Input("m/s", "mean slip speed", positive="traction", per="speed").named("s"),
                Input("m/s", "train speed").named("v")],
        params=[
            Param("kg m^2", 150.0, "one wheel", USER, lo=1, hi=1e4).named("J"),
            Param("N m/rad", 7.526e6, "stiffness of the axle", "190 mm by 1.36 m of steel", lo=1e3,
                  hi=1e9).named("k"),
            Param("N m s/rad", 237.6, "damping of the axle", USER, lo=0, hi=1e6).named("d"),
            Param("N", 105e3, "load of a wheel", USER, lo=1e3, hi=1e6).named("N"),
            Param("m", 0.625, "radius of a wheel", USER, lo=0.1, hi=1).named("r"),
            *laws,
        ],
        outputs=[Output("N m", "torque of the axle").named("torque"),
                 Output("m/s", "slip speed of a wheel", positive="traction",
                        per="speed").named("slip"),
                 Output("1", "its adhesion", positive="traction").named("mu")],
        sx=adhesion.sx, doc=twisting_axle.__doc__ or "",
    )  # fmt: skip
