"""What a page of gains tells of a front, of certificates and a statement, on made-up searches."""

from __future__ import annotations

import math
import re
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from test_search_of_a_bowl import FREES, searched

from slipctl.certify.promise import CERTIFIED, UNDECIDED
from slipctl.design import page, promises, tune
from slipctl.design.goals import Limit, Score
from slipctl.design.promises import Promises


def candidate(*means: float) -> Any:
    """Two draws of each objective, which lie 0.25 above and below its mean."""
    scores = [Score([m - 0.25, m + 0.25], []) for m in means]
    return SimpleNamespace(score=scores[0], scores=scores, numbers={"ctl.a": means[0], "ctl.b": 7})


def made(**more: Any) -> Any:
    """A search of three objectives with a front of three points; its knee is the second."""
    front = [candidate(1, 20, 900), candidate(2, 12, 800), candidate(4, 11, 500)]
    goals = [SimpleNamespace(text=t) for t in ("far", "level", "heat")]
    search = SimpleNamespace(
        objective=goals[0], others=goals[1:], objectives=goals, best=front[1],
        by_hand=candidate(8, 15, 700), limits=[], shown={}, refused={"sta": 3, "rest": 4},
        promises=SimpleNamespace(wanted=[]), thought=40, spent=90, samples=6,
    )  # fmt: skip
    found = dict(search=search, front=front, name="toy:loop", polished=None, statement=None,
                 promises=SimpleNamespace(gains=[]), slices=[], judged=None)  # fmt: skip
    return SimpleNamespace(**found | more)


def curves(axis: Any) -> dict[str, list[tuple[float, float]]]:
    """Points of each curve of a panel by its name."""
    return {str(k.get_label()): list(zip(np.ravel(k.get_xdata()).tolist(),
                                         np.ravel(k.get_ydata()).tolist(), strict=True))
            for k in axis.get_lines()}  # fmt: skip


@pytest.fixture(autouse=True)
def units(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(page, "_units", lambda found: ["m", "N m", "kJ"])


def test_a_front_is_drawn_over_its_first_objective_in_a_panel_for_each_other_one() -> None:
    found = made()
    axes = page.front_picture(found).get_axes()
    assert [a.get_xlabel() for a in axes] == ["far [m]"] * 2
    assert [a.get_ylabel() for a in axes] == ["level [N m]", "heat [kJ]"]
    assert curves(axes[0]) == {"front": [(1, 20), (2, 12), (4, 11)], "knee": [(2, 12)],
                               "by hand": [(8, 15)]}  # fmt: skip
    assert curves(axes[1]) == {"front": [(1, 900), (2, 800), (4, 500)], "knee": [(2, 800)],
                               "by hand": [(8, 700)]}  # fmt: skip


def test_what_by_hand_never_reaches_an_objective_is_no_point_in_its_panel_alone() -> None:
    found = made()
    found.search.by_hand = candidate(8, math.inf, 700)
    level, heat = (curves(a) for a in page.front_picture(found).get_axes())
    assert list(level) == ["front", "knee"]
    assert heat["by hand"] == [(8, 700)]


def test_the_pictures_begin_with_the_front_or_else_with_the_course(monkeypatch) -> None:
    monkeypatch.setattr(page, "front_picture", lambda found: "front")
    monkeypatch.setattr(page, "_course", lambda found, what: ("course", what))
    ((caption, picture),) = page.pictures(made()).items()
    assert caption.startswith("Means over the draws of the search: no candidate is better in all")
    assert picture == "front"
    ((caption, picture),) = page.pictures(made(front=[])).items()
    assert caption == "Mean over the draws of the search, against its runs."
    assert picture == ("course", ("far", "m"))


def test_pictures_of_each_objective_follow_along_its_numbers_and_on_held_out_draws(
    monkeypatch,
) -> None:
    monkeypatch.setattr(page, "front_picture", lambda found: "front")
    monkeypatch.setattr(page, "_sliced", lambda along, what, gains: (along, what, gains))
    monkeypatch.setattr(page, "_judged_picture", lambda found, terms, what, its: (terms, what, its))
    slices = [SimpleNamespace(objective=t, k=k) for k, t in enumerate(["heat", "far", "heat"])]
    for moved in (True, False):
        found = made(slices=slices, gains="gains", judged=SimpleNamespace(each=["A", "B", "C"]))
        for k, goal in enumerate(found.search.objectives):
            goal.terms = k
        found.search.by_hand = found.search.by_hand if moved else found.search.best
        captions, shown = zip(*page.pictures(found).items(), strict=True)
        assert shown == (
            "front", ([slices[1]], ("far", "m"), "gains"),
            ([slices[0], slices[2]], ("heat", "kJ"), "gains"), (0, ("far", "m"), "A"),
            (1, ("level", "N m"), "B"), (2, ("heat", "kJ"), "C"),
        )  # fmt: skip
        assert [c.split()[:2] for c in captions[1:3]] == [["Mean", "far"], ["Mean", "heat"]]
        assert "the range within 1 % is shaded" in captions[1]
        assert [c.split()[0] for c in captions[3:]] == ["far", "level", "heat"]
        assert all(("; below, tuned minus" in c) == moved for c in captions[3:])


@pytest.fixture
def short(monkeypatch: pytest.MonkeyPatch) -> None:
    """Tables and lines of which a word is enough."""
    monkeypatch.setattr(page, "differences", lambda found: ["it differs", "it differs too"])
    monkeypatch.setattr(page.statement, "lines", lambda given: [f"{given} one", f"{given} two"])
    for table in ("gains_rows", "judged_rows", "promise_rows", "front_rows"):
        monkeypatch.setattr(
            page, table, lambda found, most=page.MOST, table=table: [[table, f"{most}"], ["a", "b"]]
        )


@pytest.mark.usefixtures("short")
def test_the_terminal_has_the_front_the_proofs_and_the_statement_where_there_are_such() -> None:
    found = made(
        statement="said", polished=SimpleNamespace(text=lambda: "no exact gradient"),
        promises=SimpleNamespace(gains=["sta"]),
    )  # fmt: skip
    found.search.shown = {1: True, 5: False, 9: True}
    found.search.limits = [Limit("far<=3m", "far", True, 3.0, "m")]
    found.search.promises.wanted = [SimpleNamespace(text="margin>=1.2")]
    blocks = page.text(found).split("\n\n")
    assert blocks[0] == ("toy:loop, minimise far, level, heat, subject to far<=3m,"
                         " subject to margin>=1.2")  # fmt: skip
    assert blocks[1] == (
        "40 candidates, 7 refused by a certificate or the lack of one nearby before any run,"
        " 90 runs on 6 draws; 2 of 3 best ones are proved\nno exact gradient"
    )
    assert blocks[2].split()[:3] == ["front_rows", "12", "-" * 10]
    assert blocks[3] == page.KNEE
    assert [b.split()[0] for b in blocks[4:6]] == ["gains_rows", "judged_rows"]
    assert blocks[6] == "it differs\nit differs too"
    assert blocks[7].split()[0] == "promise_rows"
    assert blocks[8:] == ["said one", "said two"]


@pytest.mark.usefixtures("short")
def test_without_them_the_terminal_has_three_blocks() -> None:
    blocks = page.text(made(front=[])).split("\n\n")
    assert [b.split()[0] for b in blocks[2:4]] == ["gains_rows", "judged_rows"]
    assert len(blocks) == 5
    assert blocks[1].endswith("7 refused by a certificate before any run, 90 runs on 6 draws")


@pytest.mark.usefixtures("short")
@pytest.mark.parametrize("bare", [True, False])
def test_sections_of_the_page_stand_in_their_order(bare: bool, monkeypatch) -> None:
    """The front first, with all of its points; what is not there has no section."""
    monkeypatch.setattr(page, "pictures", lambda found: {"Drawn.": "fig"})
    monkeypatch.setattr(page.plots, "svg_text", lambda fig, command: f"<svg>{fig}{command}</svg>")
    monkeypatch.setattr(page, "image", lambda svg, caption: f"IMAGE {svg} {caption}")
    monkeypatch.setattr(page, "_promised", lambda found: "PROMISED")
    monkeypatch.setattr(page, "_searched", lambda found: "SEARCHED")
    more = {"front": []} if bare else {
        "statement": "said", "promises": SimpleNamespace(gains=["sta"])}  # fmt: skip
    told = page.page(made(**more), "slipctl <tune>")
    assert "<p>it differs</p><p>it differs too</p><section>" in told
    sections = dict(re.findall(r"<section><h2>(\w[\w -]*)</h2>(.*?)</section>", told, re.DOTALL))
    heads = ["Front", "Gains", "Held-out draws", "Certificates", "Statement", "Pictures", "Search"]
    assert list(sections) == [h for h in heads if not bare or h not in (
        "Front", "Certificates", "Statement")]  # fmt: skip
    row = page.table(["gains_rows", "12"], [["a", "b"]], [1])
    assert sections["Gains"].startswith(f"{row}<p>Within 1 %: range of the number")
    assert "Slope: change of the objective" in sections["Gains"]
    assert "judged_rows" in sections["Held-out draws"]
    assert sections["Pictures"] == (
        "<figure>IMAGE <svg>figslipctl <tune></svg> Drawn.<figcaption>Drawn.</figcaption></figure>"
    )
    assert sections["Search"] == "SEARCHED<pre>slipctl &lt;tune&gt;</pre>"
    assert "minimise far, level, heat" in told
    if not bare:
        assert "front_rows" in sections["Front"]
        assert '<th class="n">3</th>' in sections["Front"]
        assert sections["Front"].endswith(f"<p>{page.KNEE}</p>")
        assert "promise_rows" in sections["Certificates"]
        assert sections["Certificates"].endswith("PROMISED")
        assert sections["Statement"].startswith("<p>said one</p><p>said two</p><p>The statement")


@pytest.mark.parametrize("asked", [["sta"], [], ["sta", "rest", "third"]])
def test_which_certificates_a_candidate_had_to_have_is_said_where_others_were_free(asked) -> None:
    gains = [SimpleNamespace(name=n) for n in ("sta", "rest", "third")]
    its = SimpleNamespace(
        gains=gains, needed=lambda: [(g, 1.0, "") for g in gains if g.name in asked],
        verdict=lambda g, loop: UNDECIDED if g.name == "rest" else CERTIFIED,
        promise=lambda g, loop: f"{g.name} holds of {loop}",
    )  # fmt: skip
    told = page._promised(made(promises=its, tuned_loop=lambda: "it"))
    lines = re.findall("<p>(.*?)</p>", told)
    assert lines[0].startswith("The margin is the factor on the bounds")
    assert lines[-2:] == ["sta: sta holds of it", "third: third holds of it"]
    wanted = ["A candidate had to have: sta. It did not have to have: rest, third, which the gains"
              " set by hand do not have either."]  # fmt: skip
    assert lines[1:-2] == (wanted if asked == ["sta"] else [])


# ---- what a search says and promises -------------------------------------------------------------


def test_draws_that_the_best_numbers_lose_are_told_of_each_objective(monkeypatch) -> None:
    search, _ = searched()
    far, level = Score([1.0, math.inf, 3.0], [[0.0]] * 3), Score([1.0, 2.0, 3.0], [[0.0]] * 3)
    search.best = SimpleNamespace(score=far, scores=[level, far, far])  # type: ignore[assignment]
    goals = [SimpleNamespace(text=t) for t in ("level", "far", "farther")]
    monkeypatch.setattr(type(search), "objectives", property(lambda self: goals))
    monkeypatch.setattr(search, "holds", lambda best: True)
    search._end()
    assert search.said == [  # type: ignore[attr-defined]
        f"{t} is never reached in 1 of 3 draws, with the best numbers too; such a draw counts as"
        " worst" for t in ("far", "farther")]  # fmt: skip


def test_a_search_that_is_stopped_gives_the_best_proved_numbers_so_far(monkeypatch) -> None:
    noted = []

    def stop() -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(tune.interrupts, "note_interrupt", lambda: noted.append(1))
    search = SimpleNamespace(
        loop="loop", frees=FREES, runs=9, run=stop, objectives=["far"],
        best_proved=SimpleNamespace(numbers={"ctl.a": 1.5}),
        rolls=SimpleNamespace(begin=lambda name, many: None),
    )  # fmt: skip
    with pytest.raises(tune.Stopped) as stopped:
        tune._found(search, "toy:loop", 4, False)  # type: ignore[arg-type]
    best = stopped.value.best
    assert (best.gains, best.name, best.judged, best.slices) == (
        {"ctl.a": 1.5},
        "toy:loop",
        None,
        (),
    )
    assert noted == [1]


def test_bounds_are_as_they_are_declared_where_no_margin_is_asked_for(monkeypatch) -> None:
    """Of what is asked, decided and told; a limit holds in every draw where nobody says else."""
    system = SimpleNamespace()
    monkeypatch.setattr(promises.catalogue, "system_of_gains", lambda gains, loop: system)
    monkeypatch.setattr(promises, "exact_numbers", lambda of, own: own)
    monkeypatch.setattr(promises, "with_margin", lambda of, own, margin: margin)
    monkeypatch.setattr(promises, "is_last", lambda gains: False)
    monkeypatch.setattr(
        promises.proofs, "decide", lambda of, margin: SimpleNamespace(verdict=margin)
    )
    gains: Any = SimpleNamespace(name="sta", numbers=lambda loop: {"k": 2})
    its, loop = Promises((gains,)), SimpleNamespace()
    assert its.asked(gains, loop) == (system, 1.0)  # type: ignore[arg-type]
    assert its.decision(gains, loop).verdict == 1.0  # type: ignore[arg-type]
    assert its.verdict(gains, loop) == 1.0  # type: ignore[arg-type]
    assert its.asked(gains, loop, 2.5)[1] == its.verdict(gains, loop, 2.5) == 2.5  # type: ignore[arg-type]
    assert Limit("x", "x", True, 2.0, "m").share == 1.0
