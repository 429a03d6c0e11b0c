"""The server talks to its own page alone, survives nonsense, and ends what takes too long."""

from __future__ import annotations

import contextlib
import http.client
import json
import os
import random
import socket
import threading
from collections import deque
from urllib.parse import urlsplit

import pytest
from workbench_frames import read

pytest.importorskip("starlette", reason="the extra workbench is not installed")
pytest.importorskip("uvicorn", reason="the extra workbench is not installed")
pytest.importorskip("websockets", reason="the extra workbench is not installed")

from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.sync.client import connect

from slipctl import BadInput
from slipctl.workbench.sources.openings import Opening
from slipctl.workbench.web.guard import BURST, LONGEST, POLICY, Bucket, Guard
from slipctl.workbench.web.server import Server, page_files

WINDOW = "ab" * 16


@contextlib.contextmanager
def serving(opening):
    server = Server(opening)
    thread = threading.Thread(target=server.run, daemon=True)
    thread.start()
    try:
        yield server
    finally:
        server.stop()
        thread.join(20)


@pytest.fixture(scope="module")
def server(tmp_path_factory):
    folder = tmp_path_factory.mktemp("opened")
    with serving(Opening("subway_braking:sta", str(folder), (), False)) as made:
        yield made


def token(server) -> str:
    return urlsplit(server.address).query


def asked(server, path="/", method="GET", **headers):
    line = http.client.HTTPConnection("127.0.0.1", server.port, timeout=30)
    line.request(method, path, headers={k.replace("_", "-"): v for k, v in headers.items()})
    answer = line.getresponse()
    body = answer.read()
    line.close()
    return answer, body


def talking(server, window=WINDOW, origin="", query=None, host=""):
    own = f"http://127.0.0.1:{server.port}"
    query = token(server) if query is None else query
    address = f"ws://127.0.0.1:{server.port}/socket?window={window}&{query}"
    headers = {"Host": host} if host else None
    return connect(address, origin=own if origin == "" else origin, additional_headers=headers,
                   max_size=None)  # fmt: skip


def heard(talk, kind, seconds=60):
    """Next frame of a kind that ends its answer."""
    for _ in range(10_000):  # a silence of so many seconds ends it before
        head, _ = read(talk.recv(timeout=seconds))
        if head["kind"] == kind and head.get("end"):
            return head
    raise AssertionError(f"no answer to {kind}")


# ---- who may talk -------------------------------------------------------------------------------


@pytest.mark.second
def test_it_is_bound_to_this_machine_alone(server):
    """No other address of this machine answers; the token is long and drawn anew."""
    assert server._socket.getsockname()[0] == "127.0.0.1"
    assert len(token(server)) > 40
    with (
        pytest.raises(ConnectionRefusedError),
        socket.create_connection(("127.0.0.2", server.port), timeout=2),
    ):
        pass


def test_the_token_goes_from_the_address_into_a_cookie(server):
    answer, _ = asked(server, f"/?{token(server)}")
    assert answer.status == 303
    assert answer.getheader("location") == "/"
    cookie = answer.getheader("set-cookie")
    assert {"HttpOnly", "SameSite=strict"} <= set(cookie.split("; "))
    answer, body = asked(server, "/", Cookie=cookie.partition(";")[0])
    assert answer.status == 200
    assert b"<script" in body


@pytest.mark.parametrize("path", ["/", "/page/main.js", "/socket", "/nothing"])
@pytest.mark.parametrize(
    "query", ["", "?token=", "?token=wrong", "?token=%ff", "?" + "&".join(["token=x"] * 50)]
)
def test_without_its_token_nothing_is_handed_out(server, path, query):
    answer, body = asked(server, path + query)
    assert answer.status == 403
    assert body.startswith(b"refused")


@pytest.mark.parametrize("host", ["evil.example", "127.0.0.1", "127.0.0.1:1", "localhost.evil"])
def test_a_foreign_host_is_refused(server, host):
    """DNS rebinding: another name that leads to this machine."""
    assert asked(server, f"/?{token(server)}", Host=host)[0].status == 400


@pytest.mark.parametrize("origin", ["http://evil.example", "null", "https://127.0.0.1", "file://"])
def test_a_foreign_origin_is_refused(server, origin):
    assert asked(server, f"/?{token(server)}", Origin=origin)[0].status == 403
    with pytest.raises(InvalidStatus) as error, talking(server, origin=origin):
        pass
    assert error.value.response.status_code == 403


@pytest.mark.parametrize("query", ["", "token=wrong"])
def test_a_websocket_needs_its_token_and_an_origin(server, query):
    with pytest.raises(InvalidStatus), talking(server, query=query):
        pass
    with pytest.raises(InvalidStatus), talking(server, origin=None):
        pass


@pytest.mark.parametrize("method", ["POST", "PUT", "DELETE", "OPTIONS", "PATCH"])
def test_only_get_is_answered(server, method):
    assert asked(server, f"/?{token(server)}", method)[0].status == 405


def test_a_page_loads_its_own_files_alone(server):
    answer, body = asked(server, "/page/index.html?" + token(server))
    assert answer.getheader("content-security-policy") == POLICY
    assert "unsafe" not in POLICY
    assert b"style=" not in body
    assert b"<script>" not in body
    assert answer.getheader("x-content-type-options") == "nosniff"
    for name, (data, _) in page_files().items():
        assert b"http://" not in data.replace(b"http://www.w3.org/", b""), name
        assert b"https://" not in data.replace(b"https://github.com/leeoniya", b""), name
        foreign = name.startswith(("uPlot", "codemirror"))
        assert foreign or len(data.splitlines()) <= 300


@pytest.mark.parametrize(
    "path", ["/page/../server.py", "/page/..%2fserver.py", "/page/", "/page/guard.py", "/page/%00"]
)
def test_no_other_file_is_handed_out(server, path):
    answer, body = asked(server, f"{path}?{token(server)}")
    assert answer.status == 404
    assert b"import" not in body


def test_many_questions_at_once_are_refused_until_a_moment_has_passed():
    now = [0.0]
    bucket = Bucket(lambda: now[0])
    assert sum(bucket.take() for _ in range(5000)) == BURST
    now[0] += 1.0
    assert 0 < sum(bucket.take() for _ in range(5000)) < BURST


def test_the_guard_refuses_two_hosts_and_two_origins():
    guard = Guard(None, 80, "token")
    scope = {"type": "http", "method": "GET", "query_string": b"token=token"}
    host = (b"host", b"127.0.0.1:80")
    assert guard.refusal({**scope, "headers": [host]}) == 0
    assert guard.refusal({**scope, "headers": [host, (b"host", b"evil")]}) == 400
    own = (b"origin", b"http://127.0.0.1:80")
    assert guard.refusal({**scope, "headers": [host, own, (b"origin", b"http://evil")]}) == 403
    assert guard.refusal({**scope, "type": "websocket", "headers": [host]}) == 403


# ---- what it answers ----------------------------------------------------------------------------


def test_a_window_is_answered_and_the_newest_question_wins(server):
    with talking(server) as talk:
        talk.send(json.dumps({"kind": "model", "id": 1}))
        assert heard(talk, "model")["loop"] == "sta"
        for k in range(30):
            talk.send(json.dumps({"kind": "run", "id": 10 + k, "numbers": {"ctl.law.k1": 10 + k}}))
        ends = []
        while not ends or ends[-1] != 39:
            ends.append(heard(talk, "run")["id"])
        assert len(ends) < 30, "what was overtaken is not finished"
        assert ends == sorted(ends)


def test_two_windows_do_not_disturb_each_other(server):
    with talking(server, "1" * 32) as one, talking(server, "2" * 32) as other:
        one.send(json.dumps({"kind": "run", "id": 1, "numbers": {"ctl.law.k1": 5.0}}))
        other.send(json.dumps({"kind": "run", "id": 1, "numbers": {"ctl.law.k1": 50.0}}))
        values = [
            {m["key"]: m["value"] for m in heard(t, "run")["metrics"]}["torque_ripple"]
            for t in (one, other)
        ]
        assert values[1] > 2 * values[0] > 0
        pids = {p for w in server.windows._windows.values() for p in w.processes()}
        assert len(pids) >= 2


def test_nonsense_is_answered_in_words_and_the_page_lives(server):
    """A thousand malformed questions; a file of the folder is never made."""
    random.seed(1)
    texts = ["", "{", "null", "[]", '"x"', "{}", '{"kind": 1}', '{"kind": "run", "id": "x"}',
             '{"kind": "save", "name": "../x.toml"}', '{"kind": "nothing"}', "[" * 5000,
             '{"kind": "law", "law": "mu = ("}', '{"kind": "text", "text": 5}',
             '{"kind": "complete", "line": -1}', '{"kind": "edit", "keys": [[]]}',
             '{"kind": "run", "numbers": {"ctl.law.k1": 1e400}}',
             '{"kind": "block", "path": "../.."}']  # fmt: skip
    with talking(server, "3" * 32) as talk:
        reader = threading.Thread(target=_drain, args=(talk,), daemon=True)
        reader.start()
        for _ in range(1000):
            text = random.choice(texts)
            cut = random.randrange(len(text) + 1)
            talk.send(text if random.random() < 0.5 else text[:cut] + chr(random.randrange(300)))
    with talking(server, "4" * 32) as talk:
        talk.send(json.dumps({"kind": "run", "id": 7, "numbers": {}}))
        assert heard(talk, "run")["metrics"]
    folder = server.windows.opening.folder
    assert os.listdir(folder) == []
    assert not os.path.exists(os.path.join(os.path.dirname(folder), "x.toml"))


def _drain(talk):
    with contextlib.suppress(ConnectionClosed, TimeoutError, OSError):
        while True:
            head, _ = read(talk.recv(timeout=30))
            assert not any("fault of slipctl" in t for t in head.get("faults", [])), head


def test_a_message_that_is_too_long_closes_its_window_alone(server):
    with talking(server, "5" * 32) as talk:
        talk.send("x" * (LONGEST + 1))
        with pytest.raises(ConnectionClosed):
            deque(iter(lambda: talk.recv(timeout=30), None))
    assert asked(server, f"/?{token(server)}")[0].status == 303


def test_raw_bytes_do_not_end_the_server(server):
    random.seed(2)
    for _ in range(30):
        with socket.create_connection(("127.0.0.1", server.port), timeout=5) as line:
            line.sendall(random.randbytes(random.randrange(1, 400)) + b"\r\n\r\n")
    with socket.create_connection(("127.0.0.1", server.port), timeout=5) as line:
        line.sendall(b"GET / HTTP/1.1\r\nHost: " + b"a" * 100_000 + b"\r\n")
    assert asked(server, f"/?{token(server)}")[0].status == 303


@pytest.mark.long
def test_a_law_that_takes_too_long_is_stopped_and_the_page_lives(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "slow.py").write_text("import time\ntime.sleep(600)\n")
    opening = Opening("subway_braking:sta", str(tmp_path), ("slow.py",), False, patience=4.0)
    with serving(opening) as server, talking(server) as talk:
        talk.send(json.dumps({"kind": "model", "id": 1}))
        heard(talk, "model")
        before = [p for w in server.windows._windows.values() for p in w.processes()]
        talk.send(json.dumps({"kind": "law", "id": 2, "law": "slow.py:law"}))
        head = heard(talk, "law")
        assert "it took longer than 4 s and was stopped" in head["faults"][0]
        talk.send(json.dumps({"kind": "run", "id": 3, "numbers": {}}))
        assert heard(talk, "run")["id"] == 3
        after = [p for w in server.windows._windows.values() for p in w.processes()]
        assert before != after
        for pid in before:
            with pytest.raises(ProcessLookupError):
                os.kill(pid, 0)


# ---- the command --------------------------------------------------------------------------------


def test_a_port_that_is_taken_is_told_in_one_line(server):
    with pytest.raises(BadInput, match=f"--port {server.port}"):
        Server(Opening("subway_braking:sta", "."), server.port)


@pytest.mark.parametrize(
    ("words", "said"),
    [(["open", "nobody.toml"], "nobody.toml"), (["open", "nobody"], "no model or study"),
     (["open", "double_exponential"], "is no loop"),
     (["open", "subway_braking:nobody"], "has no loop"),
     (["open", "--port", "99999"], "no port"), (["open", "--python", "no.py"], "no file no.py")],
)  # fmt: skip
def test_what_cannot_be_opened_is_told_in_one_line(tmp_path, monkeypatch, capsys, words, said):
    from slipctl.commands.cli import main

    monkeypatch.chdir(tmp_path)
    assert main(words) == 2
    told = capsys.readouterr()
    assert told.err.count("\n") == 1
    assert said in told.err
    assert told.out == ""


def test_the_command_prints_its_address_first(tmp_path, monkeypatch, capsys):
    from slipctl.commands.arguments import parser
    from slipctl.commands.library import open as command

    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(Server, "run", lambda self: self.windows.close())
    opened = []
    monkeypatch.setattr(command.webbrowser, "open", opened.append)
    options = parser().parse_args(["open", "--no-browser", "--no-compile"])
    assert command.answer(options, "") == 0
    first = capsys.readouterr().out.splitlines()[0]
    assert first.startswith("http://127.0.0.1:")
    assert "/?token=" in first
    assert (tmp_path / "metro.toml").is_file()
    assert opened == []
