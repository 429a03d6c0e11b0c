"""``slipctl list``: what there is, each with a line of its meaning."""

from __future__ import annotations

from types import SimpleNamespace

import pytest

from slipctl.commands.library import contents
from slipctl.errors import BadInput


def listed(capsys, word="", json=False):
    assert contents.answer(SimpleNamespace(word=word, json=json), "slipctl list") == 0
    return capsys.readouterr().out


@pytest.mark.parametrize("topic", contents.TOPICS)
def test_each_has_a_line_of_its_meaning(topic):
    rows = contents.topic_rows(topic, "")
    assert len(rows) > 5
    for row in [*rows, *(b for r in rows for b in r.get("blocks", ()))]:
        assert row["doc"].strip(), row["name"]
        assert "\n" not in row["doc"]


def test_without_a_word_studies_and_models_are_listed_and_kinds_where_they_are_asked(capsys):
    """A topic alone has no other; no empty line stands before the first."""
    heads = {word: [row for row in listed(capsys, word).split("\n") if row in contents.TOPICS]
             for word in ("", *contents.TOPICS)}  # fmt: skip
    assert heads == {"": ["studies", "models"]} | {t: [t] for t in contents.TOPICS}
    assert listed(capsys).startswith("studies\n")
    with pytest.raises(BadInput, match="nothing is called 'stdies'; did you mean 'studies'"):
        listed(capsys, "stdies")
