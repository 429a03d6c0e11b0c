"""What a person asked for: a study or a file, a loop of it, a part; what was set and swapped.

A command reads its words once into a Request and hands it on. What a word stands for is found when
it is first needed, and only once. That is the study, its models with the swaps done, its cases,
and the case of the loop with what was set.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

from slipctl.block.block import Block
from slipctl.errors import BadInput
from slipctl.run.results import Case
from slipctl.study import case_setup, resolve
from slipctl.study.declaration import Study
from slipctl.study.files import trip_files


@dataclass(frozen=True)
class Request:
    """A name as it was typed, taken apart, and what shall be changed of what it stands for.

    Attributes:
        name: as it was typed.
        home: study, or file that describes one; empty for a model, an equation, a file's block.
        loop: of the study; empty for the whole study.
        scenario: in which the loop runs; empty for the first that has it.
        part: path of a part of the loop; empty for the whole loop.
        settings: ``[loop:]block.param=VALUE[unit]``, files of gains read.
        swaps: ``name=file.py:block``.
        quick: whether the quick form of the study is meant.
    """

    name: str
    home: str = ""
    loop: str = ""
    scenario: str = ""
    part: str = ""
    settings: tuple[str, ...] = ()
    swaps: tuple[str, ...] = ()
    quick: bool = False

    @classmethod
    def read(
        cls, name: str, settings: Sequence[str] = (), swaps: Sequence[str] = (), **more: Any
    ) -> Request:
        """Take a name apart: ``STUDY``, ``STUDY:LOOP[@SCENARIO][.PART]`` or a block's name.

        Raises:
            BadInput: a file of the name that is not there or cannot be run; a file of gains that
                holds none.
        """
        made = cls(
            name, settings=tuple(case_setup.open_gain_files(settings)), swaps=tuple(swaps), **more
        )
        if resolve.is_written(name):
            return made
        left, colon, right = name.rpartition(":")
        if not colon:
            study = name in resolve.studies() or name.endswith(".py") or trip_files.is_trip(name)
            return replace(made, home=name if study else "")
        if left.endswith(".py") and not resolve.has_study(left):
            return made
        whole, _, part = right.partition(".")
        loop, _, scenario = whole.partition("@")
        return replace(made, home=left, loop=loop, scenario=scenario, part=part)

    @classmethod
    def of(cls, study: Study, loop: str, settings: Sequence[str] = ()) -> Request:
        """Request for a loop, ``LOOP`` or ``LOOP@SCENARIO``, of a study that is loaded."""
        made = cls(study.name, study.name, settings=tuple(settings))
        made.__dict__["study"] = study
        return made.at(loop)

    def at(self, loop: str, scenario: str = "") -> Request:
        """Request for another loop of the same study, ``LOOP`` or ``LOOP@SCENARIO``."""
        loop, _, named = loop.partition("@")
        new = replace(self, loop=loop, scenario=named or scenario, part="")
        kept = ("study", "models", "cases")
        new.__dict__.update({k: self.__dict__[k] for k in kept if k in self.__dict__})
        return new

    # ---- what it stands for ---------------------------------------------------------------------

    @cached_property
    def study(self) -> Study:
        """The study, or the one of the file."""
        return resolve.load_study(self.home or self.name)

    @cached_property
    def models(self) -> dict[str, Any]:
        """Models of the study, with the swaps done."""
        return case_setup.read_swaps(self.study, self.swaps)

    @cached_property
    def cases(self) -> list[Case]:
        """Cases of the study, with the swaps done; nothing is set in them."""
        return resolve.build_cases(self.study, self.quick, self.models)

    @cached_property
    def case(self) -> Case:
        """Case that has the loop, and nothing else, with what was set; its first tick has run.

        Raises:
            BadInput: no such loop or scenario; what cannot be set.
        """
        scenario = self.scenario or self.declared[1].scenario.name
        cases, _ = case_setup.prepare(
            self.study, settings=self.settings, loops=[self.loop], scenarios=[scenario],
            built=(self.cases, self.models),
        )  # fmt: skip
        return cases[0]

    @cached_property
    def declared(self) -> tuple[Block, Case]:
        """The loop as the study has it, and the first case that has it."""
        wanted = f"{self.loop}@{self.scenario}" if self.scenario else self.loop
        return resolve.pick_loop(self.study, self.cases, wanted)

    @property
    def chosen(self) -> tuple[Block, Case]:
        """The loop with what was set, and its case."""
        if not (self.settings or self.swaps):
            return self.declared
        return self.case.loops[self.loop], self.case

    @cached_property
    def block(self) -> Block:
        """Block that the name stands for: a loop, a part of it, a model, an equation."""
        if not self.loop:
            return resolve.load_block(self.name)
        from slipctl.run.logs.replay import part_of

        return part_of(self.declared[0], self.part) if self.part else self.declared[0]

    # ---- what a command needs -------------------------------------------------------------------

    def needs_loop(self) -> Request:
        """The same, refused where it names no loop.

        Raises:
            BadInput: says which loops there are, or what the name is.
        """
        if self.loop:
            return self
        if self.home or self.name.endswith((".py", ".toml")):
            loops = ", ".join(f"{self.name}:{n}" for n in resolve.loop_names(self.study))
            raise BadInput(f"{self.name} is a study; write which loop: {loops}")
        resolve.load_block(self.name)  # says what it is not
        raise BadInput(f"{self.name} is no loop; write STUDY:LOOP")
