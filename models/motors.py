"""Induction motor of one axle with rotor-flux-oriented current control, in place of the lag.

Wang 2025 drives its train by "vector control" and does not tell it. Here is the usual one, in the
d-q frame that the controller turns with omega_e = p omega_m + omega_sl, d along the rotor flux that
it believes in (indirect orientation). Amplitudes, not effective values.

    psi_d' = L_m i_d/tau_r - psi_d/tau_r + omega_sl psi_q                       rotor
    psi_q' = L_m i_q/tau_r - psi_q/tau_r - omega_sl psi_d,   tau_r = L_r/R_r
    sigma L_s i_d' = u_d - R_s i_d + omega_e sigma L_s i_q - k_r (psi_d' - omega_e psi_q)  stator
    sigma L_s i_q' = u_q - R_s i_q - omega_e sigma L_s i_d - k_r (psi_q' + omega_e psi_d)
    T_m = (3/2) p k_r (psi_d i_q - psi_q i_d),   k_r = L_m/L_r

Source of the equations: Leonhard, Control of Electrical Drives, chapters 10 and 12. The data are
the per-unit values of a traction motor that has often been simulated, the MT205 of the CRH2.
(300 kW, 2000 V, 106 A, 140 Hz): R_s .15, R_r .16 ohm, leakage 1.42 and .6 mH, L_m 25.4 mH. They
are told here from the literature's use and not from its data sheet; with the slip of the plate,
1.4 %, they give 296 kW and 107 A. They are carried over to the power of one axle of this train.
"""

from math import pi

from casadi import fmax, fmin, sqrt

from slipctl import Block, Input, Output, Param, State, connect, flow, law

SOURCE = "Wang 2025"
TABLE_1 = "Wang 2025, Table 1"
GUESS = "guess, not in the paper"

PLATE = {"P": 300e3, "U": 2000.0, "I": 106.0, "f": 140.0, "slip": 0.014, "p": 2.0}
"""Plate of the motor whose data these are: W, V between lines, A, Hz, slip, pole pairs."""
CIRCUIT = {"R_s": 0.15, "R_r": 0.16, "L_ls": 1.42e-3, "L_lr": 0.6e-3, "L_m": 25.4e-3}
"""Its equivalent circuit per phase, ohm and H."""

_Z = PLATE["U"] ** 2 / (3**0.5 * PLATE["U"] * PLATE["I"])
PER_UNIT = {
    k: v / _Z if k.startswith("R") else v * 2 * pi * PLATE["f"] / _Z for k, v in CIRCUIT.items()
}
"""The same per unit of the plate's impedance; reactances at its frequency."""

P_AXLE, U_LINE = 550e3, 2000.0
"""Power of one axle in W, a tenth of (33); line voltage in V, a guess."""
OMEGA_C = 2.5 * (5.5e6 / 302e3) / 0.445
"""Speed of the motor at the corner of (33) in rad/s."""
PAIRS = 3.0
_BASE = 3**0.5 * U_LINE * (P_AXLE * PLATE["I"] / PLATE["P"] * PLATE["U"] / U_LINE)


def _R(name: str) -> float:
    """Resistance of the motor of this train in ohm."""
    return PER_UNIT[name] * U_LINE**2 / _BASE


def _L(name: str) -> float:
    """Inductance of the motor of this train in H: its corner has the plate's reactances."""
    return _R(name) / (PAIRS * OMEGA_C)


DATA = f"{GUESS}: per-unit values of the MT205"


@flow(
    T=Output("N m", "torque at the axle", positive="traction"),
    T_m=Output("N m", "torque at the motor", positive="traction"),
)
def machine(
    i_d=State("A", 0.0, "stator current along the flux, amplitude", lo=-1e5, hi=1e5),
    i_q=State("A", 0.0, "stator current across the flux, amplitude", lo=-1e5, hi=1e5),
    psi_d=State("V s", 0.0, "rotor flux in d", lo=-1e3, hi=1e3),
    psi_q=State("V s", 0.0, "rotor flux in q", lo=-1e3, hi=1e3),
    u_d=Input("V", "stator voltage in d"),
    u_q=Input("V", "stator voltage in q"),
    omega_sl=Input("rad/s", "slip frequency that the controller sets"),
    omega=Input("rad/s", "speed of the axle"),
    R_s=Param("V/A", _R("R_s"), "stator resistance", DATA, lo=1e-6, hi=1e6),
    R_r=Param("V/A", _R("R_r"), "rotor resistance", DATA, lo=1e-6, hi=1e6),
    L_ls=Param("V s/A", _L("L_ls"), "stator leakage", DATA, lo=1e-9, hi=1e6),
    L_lr=Param("V s/A", _L("L_lr"), "rotor leakage", DATA, lo=1e-9, hi=1e6),
    L_m=Param("V s/A", _L("L_m"), "main inductance", DATA, lo=1e-9, hi=1e6),
    p=Param("1", PAIRS, "pole pairs", GUESS, lo=1, hi=20),
    R_g=Param("1", 2.5, "gear, motor to axle", TABLE_1, lo=0.5, hi=20),
):
    """Induction machine in the controller's frame: rotor flux and stator current."""
    L_s, L_r = L_ls + L_m, L_lr + L_m
    k_r, sigma_L = L_m / L_r, L_s - L_m**2 / L_r
    omega_e = p * R_g * omega + omega_sl
    flux_d = R_r / L_r * (L_m * i_d - psi_d) + omega_sl * psi_q
    flux_q = R_r / L_r * (L_m * i_q - psi_q) - omega_sl * psi_d
    e_d, e_q = k_r * (flux_d - omega_e * psi_q), k_r * (flux_q + omega_e * psi_d)
    rates = dict(
        i_d=(u_d - R_s * i_d + omega_e * sigma_L * i_q - e_d) / sigma_L,
        i_q=(u_q - R_s * i_q - omega_e * sigma_L * i_d - e_q) / sigma_L,
        psi_d=flux_d,
        psi_q=flux_q,
    )
    T_m = 1.5 * p * k_r * (psi_d * i_q - psi_q * i_d)
    return rates, dict(T=R_g * T_m, T_m=T_m)


@flow(
    psi=Output("V s", "rotor flux, as the controller believes"),
    omega_sl=Output("rad/s", "slip frequency that turns the frame with the flux"),
)
def flux_model(
    psi_h=State("V s", 0.0, "rotor flux, as the controller believes"),
    i_d=Input("A", "measured current along the flux"),
    i_q=Input("A", "measured current across the flux"),
    R_r=Param(
        "V/A", _R("R_r"), "rotor resistance, as the controller knows it", DATA, lo=1e-6, hi=1e6
    ),
    L_r=Param("V s/A", _L("L_lr") + _L("L_m"), "rotor inductance, the same", DATA, lo=1e-9, hi=1e6),
    L_m=Param("V s/A", _L("L_m"), "main inductance, the same", DATA, lo=1e-9, hi=1e6),
    psi_min=Param("V s", 0.05, "floor of the division", "added", lo=1e-6, hi=100),
):
    """Current model of the rotor: tau_r psi' = L_m i_d - psi, omega_sl = L_m i_q/(tau_r psi)."""
    rate = R_r / L_r * (L_m * i_d - psi_h)
    omega_sl = R_r / L_r * L_m * i_q / fmax(psi_h, psi_min)
    return dict(psi_h=rate), dict(psi=psi_h, omega_sl=omega_sl)


@law(
    i_d_ref=Output("A", "wanted current along the flux"),
    i_q_ref=Output("A", "wanted current across the flux"),
    psi_ref=Output("V s", "wanted flux"),
)
def references(
    F_cmd=Input("N", "commanded force at the rims", positive="traction"),
    omega=Input("rad/s", "speed of the axle"),
    psi=Input("V s", "rotor flux, as the controller believes"),
    F_top=Param("N", 302e3, "largest force of all motors", f"{SOURCE} eq (33)", lo=1, hi=1e9),
    P_top=Param("W", 5.5e6, "largest power of all motors", f"{SOURCE} eq (33)", lo=1, hi=1e10),
    n_m=Param("1", 10.0, "motors", SOURCE, lo=1, hi=200),
    r=Param("m", 0.445, "wheel radius", TABLE_1, lo=0.2, hi=1),
    R_g=Param("1", 2.5, "gear, motor to axle", TABLE_1, lo=0.5, hi=20),
    p=Param("1", PAIRS, "pole pairs", GUESS, lo=1, hi=20),
    L_r=Param("V s/A", _L("L_lr") + _L("L_m"), "rotor inductance", DATA, lo=1e-9, hi=1e6),
    L_m=Param("V s/A", _L("L_m"), "main inductance", DATA, lo=1e-9, hi=1e6),
    psi_N=Param(
        "V s", 0.9 * U_LINE * (2 / 3) ** 0.5 / (PAIRS * OMEGA_C), "full flux", GUESS, lo=0, hi=1e6
    ),
    omega_w=Param(
        "rad/s", OMEGA_C, "motor speed above which the flux is weakened", GUESS, lo=1, hi=1e6
    ),
    k_psi=Param("A/(V s)", 100.0, "gain of the flux", GUESS, lo=0, hi=1e5),
    I_d=Param("A", 250.0, "largest current along the flux", GUESS, lo=1, hi=1e6),
    I_q=Param("A", 350.0, "largest current across the flux", GUESS, lo=1, hi=1e6),
    psi_min=Param("V s", 0.05, "floor of the division", "added", lo=1e-6, hi=100),
):
    """Currents for the wanted torque, limited by (33) at the wheel's speed, and for the flux."""
    F_lim = P_top / fmax(r * omega, P_top / F_top) / n_m
    T_m = r / R_g * fmax(0, fmin(F_cmd, F_lim))
    psi_ref = psi_N * omega_w / fmax(R_g * omega, omega_w)
    i_d = psi_ref / L_m + k_psi * (psi_ref - psi)
    i_q = T_m / (1.5 * p * L_m / L_r * fmax(psi, psi_min))
    return dict(i_d_ref=fmax(0, fmin(i_d, I_d)), i_q_ref=fmin(i_q, I_q), psi_ref=psi_ref)


@flow(
    u_d=Output("V", "stator voltage in d"),
    u_q=Output("V", "stator voltage in q"),
    full=Output("1", "wanted voltage by the largest one"),
)
def current_loops(
    x_d=State("V", 0.0, "integral part in d"),
    x_q=State("V", 0.0, "integral part in q"),
    i_d_ref=Input("A", "wanted current along the flux"),
    i_q_ref=Input("A", "wanted current across the flux"),
    i_d=Input("A", "measured current along the flux"),
    i_q=Input("A", "measured current across the flux"),
    psi=Input("V s", "rotor flux, as the controller believes"),
    omega_sl=Input("rad/s", "slip frequency"),
    omega=Input("rad/s", "speed of the axle"),
    alpha=Param("1/s", 2 * pi * 100, "bandwidth of the loops", GUESS, lo=1, hi=1e5),
    R_s=Param("V/A", _R("R_s"), "stator resistance", DATA, lo=1e-6, hi=1e6),
    sigma_L=Param(
        "V s/A", _L("L_ls") + _L("L_m") - _L("L_m") ** 2 / (_L("L_lr") + _L("L_m")),
        "leakage that the currents see", DATA, lo=1e-9, hi=1e6
    ),
    k_r=Param("1", _L("L_m") / (_L("L_lr") + _L("L_m")), "L_m/L_r", DATA, lo=0, hi=1),
    p=Param("1", PAIRS, "pole pairs", GUESS, lo=1, hi=20),
    R_g=Param("1", 2.5, "gear, motor to axle", TABLE_1, lo=0.5, hi=20),
    U_max=Param("V", 3600 / 3**0.5, "largest voltage: a link of 3.6 kV", GUESS, lo=1, hi=1e6),
):  # fmt: skip
    """Two PI loops with decoupling; their poles lie at alpha. The voltage is limited to a circle.

    Internal model control: gains alpha sigma L_s and alpha R_s. Across the flux the slip frequency
    in omega_e stands for the rotor, so that R_s is all that is left; along it the flux hardly
    moves. The integral parts follow the limited voltage, so that they do not wind up.
    """
    omega_e = p * R_g * omega + omega_sl
    e_d, e_q = i_d_ref - i_d, i_q_ref - i_q
    w_d = alpha * sigma_L * e_d + x_d - omega_e * sigma_L * i_q
    w_q = alpha * sigma_L * e_q + x_q + omega_e * (sigma_L * i_d + k_r * psi)
    wanted = sqrt(w_d**2 + w_q**2)
    share = U_max / fmax(wanted, U_max)
    u_d, u_q = share * w_d, share * w_q
    rates = dict(
        x_d=alpha * R_s * e_d + (u_d - w_d) * R_s / sigma_L,
        x_q=alpha * R_s * e_q + (u_q - w_q) * R_s / sigma_L,
    )
    return rates, dict(u_d=u_d, u_q=u_q, full=wanted / U_max)


def vector_drive(v: float = 0.0) -> Block:
    """Connect motor, flux model, references and current loops.

    In place of the lag, ``plant(motor=vector_drive(), h=1e-4)``; its input is ``F_cmd``, its output
    ``T``. It starts without torque, with the flux of the speed ``v``.

    Args:
        v: speed of the rim at the start in m/s.
    """
    wires = {
        "flux.i_d": "machine.i_d",
        "flux.i_q": "machine.i_q",
        "ref.F_cmd": "F_cmd",
        "ref.omega": "omega",
        "ref.psi": "flux.psi",
        "loops.i_d_ref": "ref.i_d_ref",
        "loops.i_q_ref": "ref.i_q_ref",
        "loops.i_d": "machine.i_d",
        "loops.i_q": "machine.i_q",
        "loops.psi": "flux.psi",
        "loops.omega_sl": "flux.omega_sl",
        "loops.omega": "omega",
        "machine.u_d": "loops.u_d",
        "machine.u_q": "loops.u_q",
        "machine.omega_sl": "flux.omega_sl",
        "machine.omega": "omega",
        "T": "machine.T",
    }
    drive = connect(
        "drive", wires, machine=machine, flux=flux_model, ref=references, loops=current_loops
    )
    psi = float(references(F_cmd=0.0, omega=v / 0.445, psi=1.0)["psi_ref"])
    return drive.with_params(
        **{"machine.psi_d": psi, "flux.psi_h": psi, "machine.i_d": psi / _L("L_m")}
    )
