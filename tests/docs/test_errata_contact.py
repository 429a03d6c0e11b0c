"""Errata of Wang 2025 about the contact: each number of docs/errata.md, measured."""

from errata import shows

from slipctl.models.wheel_rail import contact
from slipctl.models.wheel_rail.contact import SURFACES, creep_law, peak, polach
from slipctl.studies.hst_traction.contact import order_changes


def adhesion(law, v_s: float, surface: str) -> float:
    return law(v_s=v_s, v=40.0, **SURFACES[surface])["mu"]


def test_printed_8_brakes_in_traction():
    shows("003.1", "0.0570", adhesion(polach, 0.8, "ice"))
    shows("003.1", "0.0570", -adhesion(creep_law("printed-8"), 0.8, "ice"))
    shows("003.1", "2.88", 0.8 * 3.6)


def test_printed_7_has_no_bound_in_braking():
    printed = creep_law("printed-7")
    for v_s, before, after in ((-5.0, "3.84", "0.187"), (-10.0, "24.8", "0.170")):
        shows("003.2", before, -adhesion(printed, v_s, "dry"))
        shows("003.2", after, -adhesion(polach, v_s, "dry"))


def test_printed_6_moves_the_peaks():
    printed = creep_law("printed-6")
    shows("003.3", "4.35", 1 / SURFACES["ice"]["k_A"])
    for name, law, creep, height in (
        ("ice", printed, "1.27", "0.0550"), ("ice", polach, "1.03", "0.0574"),
        ("damp", printed, "1.07", "0.224"), ("damp", polach, "0.668", "0.253"),
    ):  # fmt: skip
        found = peak(40.0, name, law)
        shows("003.3", creep, found.location)
        shows("003.3", height, found.value)


def test_axle_load_on_one_patch():
    def stiffness(law) -> float:
        return float(law.param_values()["KEPS"])

    whole = polach.with_params(**contact.patch(2 * contact.WHEEL_LOAD))
    shows("003.4", "76562", contact.WHEEL_LOAD)
    shows("003.4", "119.62", stiffness(polach))
    shows("003.4", "94.95", stiffness(whole))
    shows("003.4", "0.794", stiffness(whole) / stiffness(polach))
    shows("003.4", "0.794", 4 ** (1 / 3) / 2)
    mixed = polach.with_params(Q=2 * contact.WHEEL_LOAD)
    shows("003.4", "0.5", stiffness(mixed) / stiffness(polach))
    for law, creep, height in ((polach, "1.03", "0.0574"), (whole, "1.16", "0.0559")):
        found = peak(40.0, "ice", law)
        shows("003.4", creep, found.location)
        shows("003.4", height, found.value)


def test_wet_and_oily_have_no_fixed_order():
    shows("003.16", "0.128", SURFACES["wet"]["mu_0"])
    shows("003.16", "0.13", SURFACES["oily"]["mu_0"])
    shows("003.16", "5.07", order_changes())
    for v, wet, oily in ((2.0, "0.1215", "0.1222"), (40.0, "0.1027", "0.1003")):
        shows("003.16", wet, peak(v, "wet").value)
        shows("003.16", oily, peak(v, "oily").value)
    shows("003.16", "0.2528", peak(40.0, "damp").value)
