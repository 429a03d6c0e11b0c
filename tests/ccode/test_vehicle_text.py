"""The C of a vehicle file: few arguments, members by their names, one function for all axles."""

from __future__ import annotations

import re
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest
from casadi import fmax, fmin

from slipctl import Block, Input, Output, Param, State, connect, every, gated, replicate, step
from slipctl.ccode import codegen
from slipctl.ccode.check.proof import module_proof
from slipctl.ccode.codegen import check
from slipctl.ccode.module.header import header
from slipctl.ccode.module.plan import Plan
from slipctl.ccode.module.source import sources
from slipctl.models import vehicle
from slipctl.models.vehicle.safe_output import contained_block
from slipctl.study.request import Request

ARGUMENTS, SUBSCRIPTS, LINES = 31, 10, 1500
"""At most: of a function, ``x[25]`` of vectors without a name in a module, lines of its source."""

_UNNAMED = re.compile(r"(?<![\w>.])(?:[xupnyh]|[a-z]\d+)\[\d+\]")
_HEAD = re.compile(r"^static [\w ]+?\*?(\w+)\(([^{;]*?)\)\n?\s*\{", re.MULTILINE)
_DECLARED = re.compile(
    r"^\s*(?:static )?(?:const )?(?:double|bool|int) [^=(]*;$|double \w+\[\d+\]", re.MULTILINE
)


@pytest.fixture(
    scope="module",
    params=["pid", "super_twisting", pytest.param("predictive", marks=pytest.mark.second)],
)
def files(request: pytest.FixtureRequest) -> dict[str, str]:
    plan = _plan(request.param)
    return {"metro.h": header(plan), **sources(plan)}


def _plan(loop: str) -> Plan:
    """Module of a controller of the metro."""
    file = Path(vehicle.__file__).parent / "files" / "metro.toml"
    asked = Request.read(f"{file}:{loop}", [])
    return Plan(asked.chosen[0][asked.study.controller], "metro")


@pytest.fixture(scope="module")
def text(files: dict[str, str]) -> str:
    return files["metro_parts.h"] + files["metro.c"]


def test_a_function_has_as_many_arguments_as_those_of_the_papers(text: str) -> None:
    given = {m[1]: m[2].count(",") + 1 for m in _HEAD.finditer(text)}
    assert {"trust", "meter", "estimator"} <= set(given)
    assert max(given.values()) <= ARGUMENTS


def test_members_are_read_by_their_names(text: str) -> None:
    assert len(_UNNAMED.findall(_DECLARED.sub("", text))) <= SUBSCRIPTS


def test_axles_share_one_function_that_is_called_in_a_loop(text: str) -> None:
    assert re.search(r"static void meter\([^{;]*int axle\)", text)
    loops = re.findall(r"for \(int axle = 0; axle < 4; \+\+axle\) \{\s*(\w+)\(", text)
    assert {"slip", "meter", "estimator", "search", "probe", "law"} <= set(loops)


def test_the_source_is_no_longer(text: str) -> None:
    if "qp_pass" not in text:
        assert text.count("\n") <= 2 * LINES  # parts and module


COMMAND = """#include "metro_parts.h"
#include "__fc_builtin.h"
extern volatile double any; /* NaN and infinity among them */
static metro_param param;
static struct metro_derived derived;
static struct metro_kept state, next;
static metro_out now;
int main(void)
{
    const int axle = Frama_C_interval(0, 3);
    metro_default(&param);
    derived.period = 0.001; /* the only one that the command needs */
    for (int i = 0; i < 4; ++i) {
        state.safe.T_h[i] = Frama_C_double_interval(0.0, 8000.0);
        state.safe.let_go[i] = Frama_C_double_interval(0.0, 10.0);
        state.safe.back[i] = Frama_C_double_interval(0.0, 10.0);
        state.safe.slow[i] = any;
        now.law_T_wanted[i] = any; now.law_sound[i] = any; now.wake_on[i] = any;
        now.trust_ready[i] = any; now.trust_test[i] = any; now.trust_stands[i] = any;
        now.trust_T_b[i] = any;
    }
    now.trust_retry = any; now.trust_v = any;
    now.trust_demand = Frama_C_double_interval(-2e6, 2e6);
    apply(&param, &now, axle);
    safe_part(&param, &derived, &state.safe, &next.safe, &now, axle);
    /*@ check \\is_finite(now.safe_T_cmd[axle]) && 0.0 <= now.safe_T_cmd[axle] <= 8000.0; */
    /*@ check 0.0 <= next.safe.T_h[axle] <= 8000.0; */
    /*@ check 0.0 <= next.safe.let_go[axle] <= param.safe_limit; */
    /*@ check 0.0 <= next.safe.back[axle] <= 10.0; */
    return 0;
}
"""
"""One tick of an axle's command, whatever its samples, its law and the believed speed are."""


@pytest.mark.second
@pytest.mark.skipif(shutil.which("frama-c") is None, reason="no Frama-C")
@pytest.mark.others("long")
def test_eva_proves_the_command_of_an_axle_whatever_its_slip_control_says(
    files: dict[str, str], tmp_path: Path
) -> None:
    """Finite and in its range, and no release counted beyond its limit, by bits of the C itself.

    Eva does not know that a comparison with NaN is false, so that is written out in the helpers.
    """
    for name, content in {**files, "main.c": COMMAND}.items():
        seen = re.sub(r"\(x ([<>]=?) bound\) \?", r"((x == x) && (x \1 bound)) ?", content)
        (tmp_path / name).write_text(seen)
    said = subprocess.run(
        ["frama-c", "-machdep", "gcc_x86_64", "-eva", "-eva-slevel", "200",
         "-warn-special-float", "none", "-eva-auto-loop-unroll", "8",
         f"{tmp_path}/main.c", f"{tmp_path}/metro.c"],
        capture_output=True, text=True, check=False,
    ).stdout  # fmt: skip
    assert re.search(r"Assertions +4 valid +0 unknown +0 invalid", said), said[-3000:]
    assert "0 alarms generated" in said


@pytest.mark.long
@pytest.mark.skipif(shutil.which("frama-c") is None, reason="no Frama-C")
@pytest.mark.parametrize("loop", ["pid", "super_twisting"])
def test_eva_proves_the_module_of_a_vehicle_file(loop: str) -> None:
    """No run-time error and every range, for any bits on any sensor and any number of ticks."""
    plan = _plan(loop)
    said = module_proof.run_eva(plan, codegen.texts(plan), finite=False)
    assert said["passed"], said


@pytest.mark.long
@pytest.mark.skipif(shutil.which("frama-c") is None, reason="no Frama-C")
def test_eva_sees_an_axle_too_many_in_the_module_of_a_vehicle_file() -> None:
    plan = _plan("pid")
    made = {f: t.replace("axle < 4", "axle < 5") for f, t in codegen.texts(plan).items()}
    assert module_proof.run_eva(plan, made, finite=False)["alarms"]


def _box(most: float) -> Block:
    @step(
        period=0.01, y=Output("1", "sum", lo=-1e6, hi=1e6),
        z=Output("1", "all", shape=(3,), lo=-1e6, hi=1e6),
    )  # fmt: skip
    def box(
        kept=State("1", 0.5, "kept", shape=(3,), lo=-most, hi=most),
        last=State("1", "begin", "last", lo=-10, hi=10),
        v=Input("1", "in", lo=-5, hi=5),
        w=Input("1", "in", shape=(3,), lo=-5, hi=5),
        k=Param("1", 0.3, "gain", lo=0, hi=1),
        begin=Param("1", 0.25, "start", lo=-1, hi=1),
    ):
        """Box."""
        following = [k * kept[i] + (1 - k) * w[i] for i in range(3)]
        total = following[0] + v * following[1] - last
        return dict(kept=following, last=k * fmin(fmax(v, -5), 5)), dict(
            y=total, z=[total * f for f in following]
        )

    return box


MADE = (
    lambda b: replicate(b, 3, ["v"]),
    lambda b: replicate(b, 3, distinct=["k"]),
    lambda b: replicate(every(b, 3, 1), 4),
    lambda b: every(replicate(b, 2, ["w"]), 3),
    lambda b: replicate(gated(b), 3),
    lambda b: replicate(every(gated(b), 2), 2, ["on"]),
    lambda b: replicate(replicate(b, 3, ["v"], axis="wheel"), 2),
    lambda b: replicate(replicate(b, 1), 2),
    lambda b: replicate(connect("two", {"b.v": "a.y", "b.w": "a.z", "y": "b.y"}, a=b, b=b), 3),
    lambda b: replicate(contained_block(gated(b)), 2),
)  # fmt: skip


@pytest.mark.parametrize("made", MADE)
def test_copies_do_what_they_do_in_python_to_the_bit(made, tmp_path: Path) -> None:
    leaves = made is MADE[-1]
    block = made(_box(2.0 if leaves else 1e9))
    rng = np.random.default_rng(1)
    inputs = {n: rng.uniform(-5, 5, (40, *s.shape)) for n, s in block.inputs.items()}
    inputs |= {n: (v > -2.0) * 1.0 for n, v in inputs.items() if n == "on"}
    found = check(block, inputs, tmp_path, name="ctl")
    assert found["passed"]
    assert all(s["absolute"] == 0 for s in found["signals"].values())
