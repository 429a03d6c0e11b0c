"""Questions of a page, and which process answers each."""

KINDS = (
    "text", "complete", "edit", "run", "model", "law", "block", "save", "verdict", "worst",
    "doubts", "signals", "region", "effects", "draws", "c", "command",
)  # fmt: skip
"""Questions, the more urgent ones first; each is a method of ``answers.Answers``."""

COMMANDS = ("report", "tune", "sweep", "replay")
"""What the command line does for the page."""

LANES = dict.fromkeys(
    ("verdict", "worst", "doubts", "signals", "region", "effects", "draws", "c"), "slow"
)
LANES["command"] = "command"
"""Which process answers a question, the first one where it is not named: a run waits for none of
them, and none of them for a command that goes on for minutes."""
