"""The server of the page: files, one websocket a window, nothing else; on this machine alone."""

from __future__ import annotations

import asyncio
import re
import secrets
import socket
import threading
from collections.abc import Callable
from contextlib import suppress
from importlib.resources import files
from typing import Any

from slipctl.errors import BadInput
from slipctl.workbench.curves import frame
from slipctl.workbench.questions import question_of_text
from slipctl.workbench.sources.openings import Opening
from slipctl.workbench.web.guard import LONGEST, Bucket, Guard
from slipctl.workbench.web.windows import Window

HOST = "127.0.0.1"

GRACE = 60.0
"""Seconds that the processes of a closed window stay: a reload finds them."""

MOST = 8
"""Windows at once."""

TYPES = {
    ".js": "text/javascript", ".css": "text/css", ".html": "text/html", ".svg": "image/svg+xml",
    ".txt": "text/plain",
}  # fmt: skip


def page_files() -> dict[str, tuple[bytes, str]]:
    """Files of the page by name, each with its type; no others are handed out."""
    folder = files("slipctl.workbench.web") / "page"
    return {
        p.name: (p.read_bytes(), TYPES[f".{p.name.rpartition('.')[2]}"])
        for p in folder.iterdir() if f".{p.name.rpartition('.')[2]}" in TYPES
    }  # fmt: skip


class Channel:
    """What goes to a window's page: of the parts of a run that wait, the newest alone."""

    def __init__(self, loop: asyncio.AbstractEventLoop) -> None:
        self._loop, self._queue, self._news = loop, [], asyncio.Event()  # type: ignore[var-annotated]

    def put(self, kind: str, data: bytes) -> None:
        """Add a frame; may be called from any thread."""
        with suppress(RuntimeError):  # the server has ended
            self._loop.call_soon_threadsafe(self._add, kind, data)

    def _add(self, kind: str, data: bytes) -> None:
        if kind == "run" and b'"rows"' in data[:4096]:
            self._queue = [(k, d) for k, d in self._queue
                           if k != "run" or b'"rows"' not in d[:4096]]  # fmt: skip
        self._queue.append((kind, data))
        self._news.set()

    async def take(self) -> bytes:
        """Next frame, when there is one."""
        while not self._queue:
            self._news.clear()
            await self._news.wait()
        data: bytes = self._queue.pop(0)[1]
        return data


class Windows:
    """Windows by the number that their page has drawn; each keeps its processes over a reload."""

    def __init__(self, opening: Opening) -> None:
        self.opening = opening
        self._windows: dict[str, Window] = {}
        self._ends: dict[str, asyncio.TimerHandle] = {}
        self._spare: Window | None = Window(opening, lambda kind, data: None).warm()

    def enter(self, name: str, send: Callable[[str, bytes], None]) -> Window:
        """Window of a page, its own from before if it is still there.

        Raises:
            BadInput: there are too many.
        """
        if name in self._ends:
            self._ends.pop(name).cancel()
        if name not in self._windows:
            if len(self._windows) >= MOST:
                raise BadInput(f"{MOST} windows are open; close one")
            spare, self._spare = self._spare, None
            self._windows[name] = spare or Window(self.opening, send)
        window = self._windows[name]
        window.send = send
        return window

    def leave(self, name: str) -> None:
        """End a window's processes in a while, unless its page comes back."""
        if name in self._windows:
            self._windows[name].send = lambda kind, data: None
            loop = asyncio.get_running_loop()
            self._ends[name] = loop.call_later(GRACE, self._end, name)

    def _end(self, name: str) -> None:
        self._ends.pop(name, None)
        window = self._windows.pop(name, None)
        if window is not None:
            threading.Thread(target=window.close, daemon=True).start()

    def close(self) -> None:
        """End all processes."""
        for window in [*self._windows.values(), *([self._spare] if self._spare else [])]:
            window.close()


def application(opening: Opening, port: int, token: str) -> tuple[Any, Windows]:
    """ASGI application behind its guard, and its windows."""
    from starlette.applications import Starlette
    from starlette.requests import Request
    from starlette.responses import RedirectResponse, Response
    from starlette.routing import Route, WebSocketRoute
    from starlette.websockets import WebSocket, WebSocketDisconnect

    windows, known = Windows(opening), page_files()

    async def home(request: Request) -> Response:
        if "token" in request.query_params:  # into a cookie, out of the address
            answer = RedirectResponse("/", 303)
            answer.set_cookie(guard.cookie, token, httponly=True, samesite="strict", path="/")
            return answer
        return Response(known["index.html"][0], media_type="text/html")

    async def file(request: Request) -> Response:
        found = known.get(request.path_params["name"])
        if found is None:
            return Response("there is no such file\n", 404)
        return Response(found[0], media_type=found[1])

    async def talk(page: WebSocket) -> None:
        name = page.query_params.get("window", "")
        if not re.fullmatch(r"[0-9a-f]{16,64}", name):
            await page.close(1008)
            return
        await page.accept()
        channel = Channel(asyncio.get_running_loop())
        try:
            window = windows.enter(name, channel.put)
        except BadInput as error:
            await page.send_bytes(frame({"kind": "model", "end": True, "faults": [str(error)]}))
            await page.close(1013)
            return

        async def answer() -> None:
            while True:
                await page.send_bytes(await channel.take())

        going = asyncio.create_task(answer())
        bucket = Bucket()
        try:
            while True:
                text = (await page.receive()).get("text")
                if text is None:
                    break
                why = "" if bucket.take() else "too many questions at once; wait a moment"
                request = question_of_text(text) if not why else None
                if request is None:
                    why = why or "that is no question"
                    channel.put("", frame({"kind": "refused", "end": True, "faults": [why]}))
                else:
                    window.ask(request)
        except WebSocketDisconnect:
            pass
        finally:
            going.cancel()
            windows.leave(name)

    app = Starlette(routes=[
        Route("/", home), Route("/page/{name}", file), WebSocketRoute("/socket", talk),
    ])  # fmt: skip
    guard = Guard(app, port, token)
    return guard, windows


class Server:
    """A server that is bound, with its address.

    Args:
        opening: what is open. port: 0 takes one that is free.

    Attributes:
        address: whole, with the token.

    Raises:
        BadInput: the port is taken; the extra is not installed.
    """

    def __init__(self, opening: Opening, port: int = 0) -> None:
        try:
            import starlette  # noqa: F401
            import uvicorn
            import websockets  # noqa: F401
        except ImportError as error:
            raise BadInput(
                f"the workbench needs {error.name}; pip install 'slipctl[workbench]'"
            ) from None
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            self._socket.bind((HOST, port))
            self._socket.listen(64)  # from now on a browser waits, and is not refused
        except (OSError, OverflowError) as error:
            self._socket.close()
            raise BadInput(f"--port {port}: {error}; leave it out for one that is free") from None
        self.port = self._socket.getsockname()[1]
        token = secrets.token_urlsafe(32)
        self.address = f"http://{HOST}:{self.port}/?token={token}"
        self.app, self.windows = application(opening, self.port, token)
        self._server = uvicorn.Server(uvicorn.Config(
            self.app, log_level="error", ws="websockets-sansio", ws_max_size=LONGEST,
            lifespan="off", access_log=False, server_header=False,
            h11_max_incomplete_event_size=2**16,
            limit_concurrency=64, timeout_graceful_shutdown=1,
        ))  # fmt: skip

    def run(self) -> None:
        """Answer until it is stopped."""
        try:
            asyncio.run(self._server.serve(sockets=[self._socket]))
        finally:
            self.windows.close()
            self._socket.close()

    def stop(self) -> None:
        """End :meth:`run`, from another thread."""
        self._server.should_exit = True
