"""Levels of a block diagram: the boxes and wires of one connected block, read off the block."""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from slipctl.block.block import Block

Port = tuple[str, str]
"""Node and signal; an input or output of the whole has the node ``"> name"`` or ``"< name"``."""


@dataclass
class Node:
    """One box, or one end of the whole (``ins`` or ``outs`` has a single signal then).

    A ``state`` of a state machine names what leads from it, not what leads to it.
    """

    key: str
    title: str
    note: str = ""
    ins: list[str] = field(default_factory=list)
    outs: list[str] = field(default_factory=list)
    box: bool = True
    deep: bool = False
    state: bool = False


@dataclass
class Level:
    """One level of a block: its boxes, and for each source the ports it feeds."""

    title: str
    nodes: dict[str, Node]
    nets: dict[Port, list[Port]]
    units: dict[Port, str]

    def label(self, port: Port) -> str:
        """What stands at a wire: signal and unit, or a condition."""
        unit = self.units[port]
        return f"{port[1]} [{unit}]" if unit else port[1]


def inner(block: Block) -> Block:
    """Return the block that a transform without a name of its own (sampled, every) was made of."""
    while block.transparent:
        block = next(iter(block.parts.values()))
    return block


def level(block: Block) -> Level:
    """Read the parts and wires of a block, or the block alone where it has no parts.

    Inputs that read a declared value and outputs that feed nothing are left out.
    """
    top = inner(block)
    if "transitions" in top.choices:
        return _states(top)
    alone = not top.wires
    parts = {top.name: block} if alone else top.parts
    nodes: dict[str, Node] = {}
    for name, part in parts.items():
        core = inner(part)
        note = ", ".join(([] if core.name == name else [core.name]) + _short_choices(part))
        nodes[name] = Node(name, name, note, deep=bool(core.wires) and not alone)
    nets: dict[Port, list[Port]] = defaultdict(list)
    units: dict[Port, str] = {}
    wires = {} if alone else top.wires
    for target, source in wires.items():
        if "." in source:
            owner, _, port = source.partition(".")
            known = {**parts[owner].states, **parts[owner].outputs}
            start, unit = (owner, port), known[port].unit
            _append(nodes[owner].outs, port)
        else:
            start, unit = (f"> {source}", source), block.inputs[source].unit
            nodes.setdefault(start[0], Node(start[0], source, outs=[source], box=False))
        units[start] = unit
        if "." in target:
            owner, _, port = target.partition(".")
            end = (owner, port)
            _append(nodes[owner].ins, port)
        else:
            end = (f"< {target}", target)
            nodes[end[0]] = Node(end[0], target, ins=[target], box=False)
        nets[start].append(end)
    for name, part in parts.items():
        for port, s in part.inputs.items():
            full = port if alone else f"{name}.{port}"
            free = alone or f"{name}.{port}" not in wires
            if free and (alone or (s.value is None and not s.noise)):
                key = f"> {full}"
                nodes[key] = Node(key, full, outs=[full], box=False)
                nets[key, full].append((name, port))
                units[key, full] = s.unit
                _append(nodes[name].ins, port)
        if alone:
            for port, s in part.outputs.items():
                key = f"< {port}"
                nodes[key] = Node(key, port, ins=[port], box=False)
                nets[name, port].append((key, port))
                units[name, port] = s.unit
                _append(nodes[name].outs, port)
    for name, part in parts.items():  # ports in the order of their declaration
        nodes[name].ins.sort(key=list(part.inputs).index)
        nodes[name].outs.sort(key=[*part.outputs, *part.states].index)
    return Level(block.name, nodes, dict(nets), units)


def _states(machine: Block) -> Level:
    """States of a state machine, and the conditions that lead from one to another."""
    values = machine.states["at"].values
    nodes = {v: Node(v, v, state=True) for v in values}
    first = values[int(float(machine.start()["at"]))]
    nodes[first].note = "first"
    nets: dict[Port, list[Port]] = {}
    for here, to, condition in machine.choices["transitions"]:
        for source in (v for v in values if v == here or (here == "*" and v != to)):
            _append(nodes[source].outs, condition)
            _append(nodes[to].ins, condition)
            nets.setdefault((source, condition), []).append((to, condition))
    return Level(machine.name, nodes, nets, dict.fromkeys(nets, ""))


def _append(items: list[str], item: str) -> None:
    if item not in items:
        items.append(item)


def _short_choices(block: Block) -> list[str]:
    out = []
    for k, v in block.choices.items():
        if k == "h":
            out.append(f"{1000 * float(v):g} ms")
        elif k == "every":
            out.append(f"every {v}")
        elif k == "method" or (k == "form" and v != "consistent"):
            out.append(str(v))
    return out
