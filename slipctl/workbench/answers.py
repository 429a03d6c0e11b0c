"""Answers to what a page asks, each told piece by piece, so that a newer question can overtake."""

from __future__ import annotations

import shlex
import time
from collections.abc import Iterator, Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

from slipctl.errors import BadInput, Faults, RunFailed
from slipctl.study.failures import blame
from slipctl.workbench.command_lines import command_words, found_gains, replayed_curves, run_command
from slipctl.workbench.curves import curves_of_run, frame
from slipctl.workbench.desk import Desk, Rig, numbers_in_words, words_of_run
from slipctl.workbench.effects import difference_rows, ensemble_rows, exact_slopes
from slipctl.workbench.findings import metric_rows, signals_at, warnings_of_rig
from slipctl.workbench.questions import COMMANDS, KINDS
from slipctl.workbench.saved_files import save_desk
from slipctl.workbench.sliders import check_numbers
from slipctl.workbench.texts import completions, faults_of_text, with_value

# what is heavy and one question alone needs is imported there: the first page does not wait

EVERY = 0.08
"""Seconds from one part of a curve to the next, while a run goes on."""

DEAR = 8.0
"""A part is told when so many times as long has passed as the last one took to tell."""

Request = Mapping[str, Any]
Head = dict[str, Any]


class Answers:
    """What answers the questions of a window.

    Args:
        desk: what is open.

    Attributes:
        kinds: questions that it answers. without: why it does not answer the others.
        stopped: said of a command that was stopped. folder: files are written there alone.
    """

    kinds: tuple[str, ...] = KINDS
    without = ""
    stopped = "stopped; the same command goes on"

    def __init__(self, desk: Desk) -> None:
        self.desk, self.folder = desk, desk.folder

    def begin(self, request: Request) -> Iterator[bytes]:
        """Begin to answer a question; what is wrong with it is told as faults, in lines.

        Args:
            request: its ``kind``, one of :data:`KINDS`, its ``id``, and what it needs: ``text``,
                ``loop``, ``scenario``, ``numbers``.

        Yields:
            Frames, see :func:`slipctl.workbench.curves.frame`; the last one has ``end``.
        """
        kind, number = str(request.get("kind")), request.get("id", 0)
        who = {"kind": kind, "id": number if isinstance(number, int) else 0}
        try:
            if kind not in KINDS:
                raise BadInput(f"there is no question {kind[:40]!r}")
            if kind not in self.kinds:
                raise BadInput(self.without)
            for part in getattr(self, kind)(request):
                yield part if isinstance(part, bytes) else frame({**who, **part})
        except (Exception, RecursionError) as error:
            yield frame({**who, "end": True, "faults": fault_lines(error)})

    # ---- what a question is about ---------------------------------------------------------------

    def _text(self, request: Request) -> str | None:
        text = request.get("text")
        if text is None or self.desk.text is None:
            return self.desk.text
        if not isinstance(text, str):
            raise BadInput("the text is no text")
        return text

    def _rig(self, request: Request) -> Rig:
        loop, scenario = request.get("loop"), request.get("scenario")
        if not (isinstance(loop, str | None) and isinstance(scenario, str | None)):
            raise BadInput("loop and scenario are no names")
        return self.desk.rig(self._text(request), loop, scenario)

    def _moved(self, request: Request, rig: Rig) -> dict[str, float]:
        return check_numbers(request.get("numbers") or {}, rig.sliders)

    # ---- the questions --------------------------------------------------------------------------

    def model(self, request: Request) -> Iterator[Head]:
        """What is open: loops, sliders, limits, certificates; of a faulty file its text alone."""
        desk, text = self.desk, self._text(request)
        try:
            study, loops = desk.study(text), desk.loops(text)
        except BadInput:
            yield {"end": True, "home": desk.home, "text": text, "broken": True,
                   "found": faults_of_text(desk.home, text or "")}  # fmt: skip
            return
        wanted = (request.get("loop"), request.get("scenario"))
        named = [pair for pair in loops if pair[0] == desk.loop]
        if wanted in loops:
            desk.loop, desk.scenario = wanted
        elif (desk.loop, desk.scenario) not in loops:
            desk.loop, desk.scenario = named[0] if named else desk.first_loop(text)
        rig = desk.rig(text)
        yield {
            "end": True, "home": desk.home, "title": study.title, "doc": study.doc,
            "text": text, "loops": loops, "loop": desk.loop, "scenario": desk.scenario,
            "sliders": [asdict(s) for s in rig.sliders], "limits": dict(study.limits),
            "certificates": rig.certificates(), "controller": study.controller,
            "ensemble": desk.scenario in study.ensembles, "tick": rig.loop.period,
            "folder": str(desk.folder),
        }  # fmt: skip

    def text(self, request: Request) -> Iterator[Head]:
        """Faults of a text, each with its line."""
        text = self._text(request)
        found = [] if text is None else faults_of_text(self.desk.home, text)
        yield {"end": True, "found": found}

    def complete(self, request: Request) -> Iterator[Head]:
        """What may stand on a line."""
        text, line = self._text(request), request.get("line")
        if text is None or not isinstance(line, int):
            raise BadInput("a completion needs a text and a line")
        yield {"end": True, "line": line, "found": completions(text, line)}

    def edit(self, request: Request) -> Iterator[Head]:
        """Text with another value at a key."""
        text, keys, value = self._text(request), request.get("keys"), request.get("value")
        path = tuple(k for k in keys if isinstance(k, str)) if isinstance(keys, list) else ()
        if text is None or not path or not isinstance(value, str):
            raise BadInput("an edit needs a text, keys and a value; a study has no text")
        yield {"end": True, "text": with_value(text, path, value)}

    def run(self, request: Request) -> Iterator[bytes | Head]:
        """Curves of a run while it rolls, then its metrics."""
        rig = self._rig(request)
        numbers = self._moved(request, rig)
        who = {"kind": "run", "id": request.get("id", 0), "loop": rig.name}
        begun = time.perf_counter()
        rolled, compiled = None, False
        while rolled is None:
            compiled, measured, next_one = rig.compiled, rig.measured, 0.0
            for share, so_far in measured.prepared.pieces(numbers):
                now = time.perf_counter()
                if share >= 1.0:
                    rolled = so_far()
                elif rig.compiled and not compiled:
                    break  # begin anew, compiled: the same bits, much sooner
                elif now >= next_one:
                    seen = measured.seen(so_far())
                    yield frame({**who, "share": share, "compiled": compiled},
                                curves_of_run(seen, rig.case.known), 400)  # fmt: skip
                    after = time.perf_counter()
                    next_one = after + max(EVERY, DEAR * (after - now))
                else:
                    yield b""  # a newer question may overtake here
        seen = measured.seen(rolled)
        spent = time.perf_counter() - begun
        yield frame({**who, "share": 1.0, "compiled": compiled, "seconds": spent},
                    curves_of_run(seen, rig.case.known))  # fmt: skip
        words = words_of_run(self.desk, self.desk.loop, numbers_in_words(numbers, rig.sliders))
        yield {"end": True, "metrics": metric_rows(measured.metrics(rolled), rig.study.limits),
               "command": shlex.join(["slipctl", *words])}  # fmt: skip

    def doubts(self, request: Request) -> Iterator[bytes | Head]:
        """What gives reason to doubt the run, in words; it is rolled again and watched."""
        rig = self._rig(request).wait()
        numbers = self._moved(request, rig)
        pieces = rig.measured.prepared.pieces(numbers, doubt=True)
        _, so_far = next(pieces)
        for _, so_far in pieces:  # noqa: B007  the last one is the whole run
            yield b""
        yield {"end": True, "warnings": warnings_of_rig(rig, so_far())}

    def signals(self, request: Request) -> Iterator[Head]:
        """Every signal of the loop at a time of the run."""
        rig, at = self._rig(request), request.get("time")
        if not isinstance(at, int | float) or isinstance(at, bool):
            raise BadInput("signals are asked for at a time in s")
        found = signals_at(rig, self._moved(request, rig), float(at))
        yield {"end": True, "time": at, "signals": found}

    def law(self, request: Request) -> Iterator[Head]:
        """The adhesion law of what is open, or one that was typed: equations and curve."""
        from slipctl.workbench.laws import law_of_desk, law_of_text, law_view

        typed = request.get("law")
        if isinstance(typed, str) and typed.strip():
            if len(typed) > 2000:
                raise BadInput("a law has at most 2000 letters")
            yield {"end": True, "law": law_view(law_of_text(typed.strip())), "typed": typed}
            return
        block, text = law_of_desk(self.desk, self._rig(request))
        yield {"end": True, "law": law_view(block), "typed": text}

    def block(self, request: Request) -> Iterator[Head]:
        """A part of the loop: diagram, equations, Jacobian."""
        from slipctl.workbench.laws import block_view

        path = request.get("path", "")
        if not isinstance(path, str):
            raise BadInput("a part is named by a text")
        yield {"end": True, "block": block_view(self._rig(request).loop, path)}

    def verdict(self, request: Request) -> Iterator[Head]:
        """Certificate of the loop with the numbers as they are."""
        from slipctl.workbench.safety import verdict_of_gains

        rig = self._rig(request)
        gains = rig.gains_by_name(str(request.get("name") or ""))
        yield {"end": True, "verdict": verdict_of_gains(rig, gains, self._moved(request, rig))}

    def worst(self, request: Request) -> Iterator[bytes | Head]:
        """Run of the certificate's equations against their worst disturbance."""
        from slipctl.workbench.safety import worst_run

        rig = self._rig(request)
        gains = rig.gains_by_name(str(request.get("name") or ""))
        curves, lines = worst_run(rig, gains, self._moved(request, rig))
        who = {"kind": "worst", "id": request.get("id", 0), "loop": gains.name}
        yield frame({**who, "end": True, "said": lines}, curves)

    def region(self, request: Request) -> Iterator[Head | bytes]:
        """Where two gains are certified, refuted or undecided, row by row."""
        from slipctl.workbench.safety import region_rows

        rig = self._rig(request)
        gains = rig.gains_by_name(str(request.get("name") or ""))
        axes = request.get("axes")
        pair = tuple(map(str, axes)) if isinstance(axes, list) and len(axes) == 2 else None
        for row in region_rows(rig, gains, self._moved(request, rig), pair):  # type: ignore[arg-type]
            yield {"region": row} if row else b""
        yield {"end": True}

    def effects(self, request: Request) -> Iterator[Head]:
        """What each gain of the law, and each number that was moved, does to the metrics."""
        rig = self._rig(request)
        numbers = self._moved(request, rig)
        chosen = [s for s in rig.sliders if s.group == "law" or s.name in numbers][:12]
        if not chosen:
            raise BadInput("the law has no gains; move a number to see what it does")
        rig.wait()
        for row in difference_rows(rig, numbers, chosen):
            yield {"effect": row}
        try:
            yield {"end": True, "exact": exact_slopes(rig, numbers, [s.name for s in chosen])}
        except (BadInput, RunFailed) as error:
            yield {"end": True, "why": str(error)}

    def draws(self, request: Request) -> Iterator[Head]:
        """A small ensemble with the numbers as they are, run by run."""
        rig = self._rig(request)
        for row in ensemble_rows(rig, self._moved(request, rig)):
            yield {"ensemble": row}
        yield {"end": True}

    def c(self, request: Request) -> Iterator[Head]:
        """The C of the controller."""
        from slipctl.workbench.c_texts import c_of_rig

        rig = self._rig(request)
        target = "cortex-m4" if request.get("target") == "cortex-m4" else "host"
        yield {"end": True, "c": c_of_rig(rig, self._moved(request, rig), target=target)}

    def save(self, request: Request) -> Iterator[Head]:
        """Write the file, with the numbers that were moved."""
        rig = self._rig(request)
        name = request.get("name") or ""
        if not isinstance(name, str) or len(name) > 200:
            raise BadInput("a file is named by a text")
        done = save_desk(self.desk, name, self._text(request), self._moved(request, rig))
        yield {"end": True, **done}

    def command(self, request: Request) -> Iterator[bytes | Head]:
        """Report, search, sweep or replay of what is saved, as the command line does it."""
        asked = str(request.get("command"))
        if asked == "stop":  # a newer question has ended the older one
            yield {"end": True, "command": asked, "said": self.stopped}
            return
        words, out = self._words(asked, request)
        said: Head = {}
        for said in run_command(words):
            yield {"command": asked, **said} if "progress" in said else b""
        if asked in ("tune", "replay") and said["code"]:
            raise BadInput(said["said"].strip().rpartition("\n")[2] or f"{asked} failed")
        if asked == "replay":
            who = {"kind": "command", "id": 0, "loop": "replay", "share": 1.0}
            yield frame(who, replayed_curves(out))
        sliders = self._rig(request).sliders if asked == "tune" else []
        gains = found_gains(out, sliders) if asked == "tune" else {}
        report = out.relative_to(self.folder) / "report.html"
        yield {"end": True, "command": asked, "said": said["said"], "line": said["command"],
               "gains": gains, "file": str(report)}  # fmt: skip

    def _words(self, asked: str, request: Request) -> tuple[list[str], Path]:
        """Words of a command behind ``slipctl``, and the folder that it writes."""
        if asked not in COMMANDS:
            raise BadInput(f"there is no command {asked[:40]!r}; {', '.join(COMMANDS)}")
        rig = self._rig(request)
        if self._text(request) != self.desk.saved():
            raise BadInput(f"save the text first; {asked} takes the file")
        return command_words(asked, self.desk, rig, self._moved(request, rig), request)


def fault_lines(error: BaseException) -> list[str]:
    """What is wrong, in lines, as the command line would say it."""
    try:
        blame(error)
    except Faults as known:
        return list(known.lines)
    except (BadInput, RunFailed) as known:
        return [str(known)]
    except BaseException as other:
        return [f"a fault of slipctl, {type(other).__name__}: {str(other).partition(chr(10))[0]}"]
