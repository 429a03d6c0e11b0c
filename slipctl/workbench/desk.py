"""What is open: a vehicle's file or a study, one loop of it in a scenario, ready to run."""

from __future__ import annotations

import threading
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

from slipctl.block.block import Block
from slipctl.errors import BadInput
from slipctl.run.results import Case
from slipctl.run.sweep.sweep_runs import Measured
from slipctl.study import resolve
from slipctl.study.declaration import Gains, Study
from slipctl.study.files import trip_files
from slipctl.study.request import Request
from slipctl.workbench.sliders import Slider, sliders_of_loop

KEPT = 4
"""Loops that stay ready to run, the last ones."""

SHORT = 0.25
"""Seconds that a run waits for its compiled code before it goes on interpreted."""

LEFT_OUT = ("ideal",)
"""Loops that are no controller: the bound that others are measured against."""


@dataclass
class Rig:
    """A loop that is ready to run.

    Attributes:
        study: that it is of. case: its scenario. name: of the loop. loop: itself.
        compile: whether to compile it; it rolls interpreted, with the same bits, until that is
            done.
    """

    study: Study
    case: Case
    name: str
    loop: Block
    compile: bool = True
    _compiled: list[Measured] = field(default_factory=list)

    def __post_init__(self) -> None:
        self._thread: threading.Thread | None = None
        if self.compile:
            self._thread = threading.Thread(target=self._build, daemon=True)
            self._thread.start()
            self._thread.join(SHORT)

    def _build(self) -> None:
        with suppress(Exception):  # what is wrong with it, the interpreted one says
            self._compiled.append(self._made(True))

    def _made(self, compiled: bool) -> Measured:
        case = self.case
        return Measured(self.loop, case.scenario, self.study.signals, case.known, (), compiled)

    @cached_property
    def interpreted(self) -> Measured:
        """What rolls without compiled code."""
        return self._made(False)

    @property
    def compiled(self) -> bool:
        """Whether the compiled code is there."""
        return bool(self._compiled)

    @property
    def measured(self) -> Measured:
        """What rolls: compiled as soon as that is there."""
        return self._compiled[0] if self._compiled else self.interpreted

    def wait(self) -> Rig:
        """The same, when it is compiled."""
        if self._thread is not None:
            self._thread.join()
        return self

    @cached_property
    def sliders(self) -> list[Slider]:
        """Numbers that can be moved."""
        return sliders_of_loop(self.loop, self.case.scenario, self.study.controller)

    @property
    def gains(self) -> list[Gains]:
        """What the study asks a certificate of, of this loop."""
        here = {self.name, f"{self.name}@{self.case.scenario.name}"}
        return [g for g in self.study.certificates.gains if g.loop in here]

    def certificates(self) -> dict[str, Any]:
        """Which certificates can be asked for, or why there is none."""
        why = self.study.certificates.uncertified.get(self.name, "")
        if not self.gains and not why:
            why = "the study declares no gains of this loop to certify"
        return {"names": [g.name for g in self.gains], "why": why}

    def gains_by_name(self, name: str = "") -> Gains:
        """What is asked of a certificate by its name; of the first one without.

        Raises:
            BadInput: there is none; says why.
        """
        found = next((g for g in self.gains if name in ("", g.name)), None)
        if found is None:
            raise BadInput(f"{self.name} has no certificate{f' {name!r}' if name else ''}:"
                           f" {self.certificates()['why'] or 'choose another'}")  # fmt: skip
        return found


class Desk:
    """A window's state, and what answers it.

    Args:
        name: ``metro.toml``, a study, ``study:loop[@scenario]``, a file of a study ``my.py``.
        folder: where files are written; none is written elsewhere.
        compile: compile loops where there is a compiler.

    Attributes:
        home: file or study. loop, scenario: what is looked at.
        text: of the file as it is edited; None for a study of the library.

    Raises:
        BadInput: there is no such thing.
    """

    def __init__(self, name: str, folder: str | Path = ".", compile: bool = True) -> None:
        asked = Request.read(name)
        if not asked.home:
            raise BadInput(f"{name} is no vehicle's file, study or loop; see slipctl list")
        self.folder, self.compile, self.home = Path(folder).resolve(), compile, asked.home
        self.text: str | None = None
        if self.home.endswith(".toml"):
            self.text = self._read(self.home)
        self._studies: dict[str | None, Study] = {}
        self._rigs: dict[tuple[str | None, str, str], Rig] = {}
        self.loop, self.scenario = asked.loop, asked.scenario
        if not self.loop:
            with suppress(BadInput):  # a file with faults is opened all the same, to mend it
                self.loop, self.scenario = self.first_loop()

    def _read(self, path: str) -> str:
        if not Path(path).is_file():
            raise BadInput(f"there is no file {path}; slipctl new metro {path} writes one")
        return Path(path).read_text(encoding="utf-8-sig")

    def saved(self) -> str | None:
        """Text of the file as it lies there; None of a study of the library."""
        return None if self.text is None else self._read(self.home)

    def first_loop(self, text: str | None = None) -> tuple[str, str]:
        """Loop to begin with: the first that has a certificate, else a controller.

        Raises:
            BadInput, Faults: what is wrong in the text.
        """
        found = self.loops(text)
        names = [n for n, _ in found]
        gains, _ = self.study(text).certificates
        certain = next((g.loop for g in gains if g.loop in names), None)
        name = certain or next((n for n in names if n != "none"), names[0])
        return next(pair for pair in found if pair[0] == name)

    def study(self, text: str | None = None) -> Study:
        """Study as the text has it; without one as it is.

        Raises:
            BadInput, Faults: what is wrong in it.
        """
        text = self.text if text is None else text
        if text not in self._studies:
            if text is None:
                made = resolve.load_study(self.home)
            else:
                made = trip_files.study_of_text(self.home, text)
            while len(self._studies) >= KEPT:
                self._studies.pop(next(iter(self._studies)))
            self._studies[text] = made
        return self._studies[text]

    def loops(self, text: str | None = None) -> list[tuple[str, str]]:
        """Loops that can be looked at, each with its scenario."""
        study = self.study(text)
        cases = resolve.build_cases(study)
        return [(n, c.scenario.name) for c in cases for n in c.loops if n not in LEFT_OUT]

    def rig(
        self, text: str | None = None, loop: str | None = None, scenario: str | None = None
    ) -> Rig:
        """Loop of a text, ready to run; what was ready a short while ago still is.

        Raises:
            BadInput, Faults: what is wrong in the text; no such loop.
        """
        text = self.text if text is None else text
        key = (text, loop or self.loop, self.scenario if scenario is None else scenario)
        if key in self._rigs:
            self._rigs[key] = self._rigs.pop(key)
        else:
            study = self.study(text)
            name = f"{key[1]}@{key[2]}" if key[2] else key[1]
            block, case = Request.of(study, name).declared
            while len(self._rigs) >= KEPT:
                self._rigs.pop(next(iter(self._rigs)))
            self._rigs[key] = Rig(study, case, key[1], block, self.compile)
        return self._rigs[key]

    def within(self, name: str, suffix: str = ".toml") -> Path:
        """Path of a file in the folder that was opened.

        Raises:
            BadInput: it would lie elsewhere, or has another ending.
        """
        path = (self.folder / name).resolve()
        if not path.is_relative_to(self.folder) or "\0" in name:
            raise BadInput(f"{name} lies outside of {self.folder}; files are written there alone")
        if suffix and path.suffix != suffix:
            raise BadInput(f"{name} must end in {suffix}")
        return path


def numbers_in_words(numbers: Mapping[str, float], sliders: Sequence[Slider]) -> list[str]:
    """Numbers as ``--set`` takes them."""
    units = {s.name: s.unit for s in sliders}
    return [
        f"{n}={float(v)!r}{'' if units.get(n, '1') == '1' else ' ' + units[n]}"
        for n, v in numbers.items()
    ]


def words_of_run(desk: Desk, loop: str, moved: Sequence[str]) -> list[str]:
    """Words behind ``slipctl`` of a run with numbers that were moved, as ``--set`` takes them."""
    words = ["run", desk.home, "--loop", loop]
    words += ["--scenario", desk.scenario] if desk.scenario else []
    return [*words, *(["--set", *moved] if moved else [])]
