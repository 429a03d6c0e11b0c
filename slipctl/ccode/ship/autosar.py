"""A module as a software component of AUTOSAR Classic: a C file with runnables, and its ARXML.

The component has a port that requires the inputs and one that provides the outputs and the status,
a runnable for the start and one for the tick. It reads and writes by the implicit access of the RTE
(``Rte_IRead_...``), whose generator makes ``Rte_ctl_swc.h`` from the ARXML file. There is one
instance, with the default parameters. Schema: AUTOSAR_00048 (R19-11).
"""

from __future__ import annotations

from xml.etree import ElementTree

from slipctl.ccode.compile.template import fill_template
from slipctl.ccode.module.header import CONTENT, head
from slipctl.ccode.module.layout import Member
from slipctl.ccode.module.plan import Plan
from slipctl.errors import BadInput

SCHEMA = "AUTOSAR_00048.xsd"
_NAMESPACE = "http://autosar.org/schema/r4.0"


def texts(plan: Plan) -> dict[str, str]:
    """Text of both files by name.

    Raises:
        BadInput: the block has no period.
    """
    if not plan.period:
        raise BadInput(f"{plan.name} has no period; an AUTOSAR component needs one for its tick")
    return {f"{plan.name}_swc.c": _source(plan), f"{plan.name}.arxml": _arxml(plan)}


def _source(plan: Plan) -> str:
    n, lay, swc = plan.name, plan.layout, f"{plan.name}_swc"
    lines = [f"    {n}_in in;", f"    {n}_out out;", "    int status;"]
    for m in lay.inputs:
        there = f"Rte_IRead_{swc}_step_in_{m.c}()"
        if m.scalar:
            lines.append(f"    in.{m.c} = {there};")
        else:
            lines.append(f"    (void)memcpy(in.{m.c}, {there}, sizeof(in.{m.c}));")
    if not lay.inputs:
        lines.append("    in.unused = 0;")
    lines.append(f"    status = {n}_step(&in, &param, &state, &out);")
    lines += [f"    Rte_IWrite_{swc}_step_out_{m.c}(out.{m.c});" for m in lay.outputs]
    lines.append(f"    Rte_IWrite_{swc}_step_out_{_status(plan)}((sint32)status);")
    return fill_template(
        "swc.c", n=n, swc=swc, head=head(plan, f"{swc}.c"), body="\n".join(lines),
        arrays=any(not m.scalar for m in lay.inputs),
    )  # fmt: skip


class _Tree:
    """Elements of ARXML, one below the other."""

    def __init__(self, element: ElementTree.Element) -> None:
        self.element = element

    def add(self, tag: str, text: str = "", **attributes: str) -> _Tree:
        made = ElementTree.SubElement(self.element, tag, attributes)
        made.text = text or None
        return _Tree(made)

    def named(self, tag: str, name: str) -> _Tree:
        made = self.add(tag)
        made.add("SHORT-NAME", name)
        return made

    def refer(self, tag: str, kind: str, path: str) -> None:
        self.add(tag, path, DEST=kind)


def _arxml(plan: Plan) -> str:
    n, lay, swc = plan.name, plan.layout, f"{plan.name}_swc"
    root = _Tree(ElementTree.Element("AUTOSAR", {
        "xmlns": _NAMESPACE, "xmlns:xsi": "http://www.w3.org/2001/XMLSchema-instance",
        "xsi:schemaLocation": f"{_NAMESPACE} {SCHEMA}",
    }))  # fmt: skip
    package = root.add("AR-PACKAGES").named("AR-PACKAGE", n)
    said = f"Written by slipctl, content {CONTENT}. Licence: Apache-2.0"
    package.add("DESC").add("L-2", said, L="EN")
    elements = package.add("ELEMENTS")
    _types(plan, elements)
    for port, members in (("in", lay.inputs), ("out", lay.outputs)):
        interface = elements.named("SENDER-RECEIVER-INTERFACE", f"{n}_{port}")
        interface.add("IS-SERVICE", "false")
        if members or port == "out":
            listed = interface.add("DATA-ELEMENTS")
            for m in members:
                _element(n, listed, m.c, _type(plan, m), m.signal.doc)
            if port == "out":
                _element(
                    n, listed, _status(plan), "sint32", "what the step returns; 0: all is well"
                )
    component = elements.named("APPLICATION-SW-COMPONENT-TYPE", swc)
    ports = component.add("PORTS")
    provided = ports.named("P-PORT-PROTOTYPE", "out")
    provided.refer("PROVIDED-INTERFACE-TREF", "SENDER-RECEIVER-INTERFACE", f"/{n}/{n}_out")
    if lay.inputs:
        required = ports.named("R-PORT-PROTOTYPE", "in")
        required.refer("REQUIRED-INTERFACE-TREF", "SENDER-RECEIVER-INTERFACE", f"/{n}/{n}_in")
    _behaviour(plan, component)
    made = elements.named("SWC-IMPLEMENTATION", f"{swc}_implementation")
    made.add("PROGRAMMING-LANGUAGE", "C")
    made.refer("BEHAVIOR-REF", "SWC-INTERNAL-BEHAVIOR", f"/{n}/{swc}/behaviour")
    ElementTree.indent(root.element)
    text = ElementTree.tostring(root.element, encoding="unicode")
    return f'<?xml version="1.0" encoding="utf-8"?>\n{text}\n'


def _behaviour(plan: Plan, component: _Tree) -> None:
    """Runnables, and the events that start them."""
    n, lay, swc = plan.name, plan.layout, f"{plan.name}_swc"
    here = f"/{n}/{swc}/behaviour"
    behaviour = component.add("INTERNAL-BEHAVIORS").named("SWC-INTERNAL-BEHAVIOR", "behaviour")
    events = behaviour.add("EVENTS")
    first = events.named("INIT-EVENT", "start")
    first.refer("START-ON-EVENT-REF", "RUNNABLE-ENTITY", f"{here}/{swc}_init")
    tick = events.named("TIMING-EVENT", "tick")
    tick.refer("START-ON-EVENT-REF", "RUNNABLE-ENTITY", f"{here}/{swc}_step")
    tick.add("PERIOD", repr(float(plan.period or 0.0)))
    runnables = behaviour.add("RUNNABLES")
    for name in ("init", "step"):
        runnable = runnables.named("RUNNABLE-ENTITY", f"{swc}_{name}")
        runnable.add("MINIMUM-START-INTERVAL", "0")
        runnable.add("CAN-BE-INVOKED-CONCURRENTLY", "false")
        if name == "step":
            read = [m.c for m in lay.inputs]
            if read:
                _accesses(n, runnable, "DATA-READ-ACCESSS", "in", "R-PORT-PROTOTYPE", read)
            told = [*(m.c for m in lay.outputs), _status(plan)]
            _accesses(n, runnable, "DATA-WRITE-ACCESSS", "out", "P-PORT-PROTOTYPE", told)
        runnable.add("SYMBOL", f"{swc}_{name}")
    behaviour.add("SUPPORTS-MULTIPLE-INSTANTIATION", "false")


def _accesses(n: str, runnable: _Tree, tag: str, port: str, kind: str, names: list[str]) -> None:
    accesses = runnable.add(tag)
    for name in names:
        access = accesses.named("VARIABLE-ACCESS", f"{port}_{name}")
        what = access.add("ACCESSED-VARIABLE").add("AUTOSAR-VARIABLE-IREF")
        what.refer("PORT-PROTOTYPE-REF", kind, f"/{n}/{n}_swc/{port}")
        data = f"/{n}/{n}_{port}/{name}"
        what.refer("TARGET-DATA-PROTOTYPE-REF", "VARIABLE-DATA-PROTOTYPE", data)


def _element(n: str, listed: _Tree, name: str, kind: str, doc: str) -> None:
    element = listed.named("VARIABLE-DATA-PROTOTYPE", name)
    if doc:
        element.add("DESC").add("L-2", " ".join(doc.split()), L="EN")
    element.refer("TYPE-TREF", "IMPLEMENTATION-DATA-TYPE", f"/{n}/{kind}")


def _status(plan: Plan) -> str:
    """Name of the data element that tells the status."""
    return "status" + "_" * any(m.c == "status" for m in plan.layout.outputs)


def _type(plan: Plan, m: Member) -> str:
    """Name of the type of a signal: a number, or an array of so many."""
    return _number(plan) if m.scalar else f"{_number(plan)}_{m.size}"


def _number(plan: Plan) -> str:
    return "float64" if plan.real == "double" else "float32"


def _types(plan: Plan, elements: _Tree) -> None:
    """Types of numbers and of arrays, on base types of their own."""
    n, real = plan.name, _number(plan)
    for name, bits, encoding, native in (
        (real, "64" if plan.real == "double" else "32", "IEEE754", plan.real),
        ("sint32", "32", "2C", "int"),
    ):
        base = elements.named("SW-BASE-TYPE", f"base_{name}")
        base.add("CATEGORY", "FIXED_LENGTH")
        base.add("BASE-TYPE-SIZE", bits)
        base.add("BASE-TYPE-ENCODING", encoding)
        base.add("NATIVE-DECLARATION", native)
        made = elements.named("IMPLEMENTATION-DATA-TYPE", name)
        made.add("CATEGORY", "VALUE")
        _on(made, "BASE-TYPE-REF", "SW-BASE-TYPE", f"/{n}/base_{name}")
    sizes = {m.size for m in (*plan.layout.inputs, *plan.layout.outputs) if not m.scalar}
    for size in sorted(sizes):
        made = elements.named("IMPLEMENTATION-DATA-TYPE", f"{real}_{size}")
        made.add("CATEGORY", "ARRAY")
        inner = made.add("SUB-ELEMENTS").named("IMPLEMENTATION-DATA-TYPE-ELEMENT", "element")
        inner.add("CATEGORY", "TYPE_REFERENCE")
        inner.add("ARRAY-SIZE", str(size))
        inner.add("ARRAY-SIZE-SEMANTICS", "FIXED-SIZE")
        _on(inner, "IMPLEMENTATION-DATA-TYPE-REF", "IMPLEMENTATION-DATA-TYPE", f"/{n}/{real}")


def _on(made: _Tree, tag: str, kind: str, path: str) -> None:
    """What a type is made of."""
    variants = made.add("SW-DATA-DEF-PROPS").add("SW-DATA-DEF-PROPS-VARIANTS")
    variants.add("SW-DATA-DEF-PROPS-CONDITIONAL").refer(tag, kind, path)
