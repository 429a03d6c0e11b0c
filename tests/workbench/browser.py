"""A real browser, driven over its own protocol: pages, clicks, pictures, and its complaints."""

from __future__ import annotations

import base64
import itertools
import json
import shutil
import subprocess
import tempfile
import time
from contextlib import suppress
from pathlib import Path
from typing import Any

NAMES = ("chromium", "chromium-browser", "google-chrome")


def executable() -> str | None:
    """Path of a browser, or None."""
    return next(filter(None, map(shutil.which, NAMES)), None)


class Browser:
    """A headless browser with one page.

    Attributes:
        complaints: errors of the console, of scripts and of requests. requests: addresses asked.
    """

    def __init__(self, width: int = 1280, height: int = 720, dark: bool = False) -> None:
        from websockets.sync.client import connect

        self._folder = tempfile.TemporaryDirectory(ignore_cleanup_errors=True)
        path = executable()
        assert path is not None
        self._process = subprocess.Popen(
            [path, "--headless=new", "--no-sandbox", "--disable-gpu", "--disable-dev-shm-usage",
             "--no-first-run", "--disable-background-networking", "--remote-debugging-port=0",
             f"--user-data-dir={self._folder.name}", f"--window-size={width},{height}",
             "about:blank"],
            stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
        )  # fmt: skip
        port = self._port()
        self._numbers = itertools.count(1)
        self.complaints: list[str] = []
        self.requests: list[str] = []
        made = connect(f"ws://127.0.0.1:{port[0]}{port[1]}", max_size=None)
        self._socket = made.__enter__()
        target = self.call("Target.createTarget", url="about:blank")["targetId"]
        self._session = self.call("Target.attachToTarget", targetId=target, flatten=True)[
            "sessionId"
        ]
        for domain in ("Page", "Runtime", "Log", "Network"):
            self.page(f"{domain}.enable")
        self.page("Emulation.setDeviceMetricsOverride", width=width, height=height,
                  deviceScaleFactor=1, mobile=False)  # fmt: skip
        if dark:
            self.page("Emulation.setEmulatedMedia",
                      features=[{"name": "prefers-color-scheme", "value": "dark"}])  # fmt: skip

    def _port(self) -> tuple[str, str]:
        file = Path(self._folder.name) / "DevToolsActivePort"
        for _ in range(300):
            if file.is_file() and len(lines := file.read_text().split()) == 2:
                return lines[0], lines[1]
            time.sleep(0.1)
        raise RuntimeError("the browser did not begin")

    def _send(self, method: str, given: dict[str, Any], session: bool) -> Any:
        number = next(self._numbers)
        said = {"id": number, "method": method, "params": given}
        self._socket.send(json.dumps(said | ({"sessionId": self._session} if session else {})))
        while True:
            heard = json.loads(self._socket.recv(timeout=60))
            if heard.get("id") == number:
                if "error" in heard:
                    raise RuntimeError(f"{method}: {heard['error']}")
                return heard["result"]
            self._note(heard)

    def _note(self, heard: dict[str, Any]) -> None:
        method, given = heard.get("method", ""), heard.get("params", {})
        if method == "Runtime.exceptionThrown":
            found = given["exceptionDetails"]
            self.complaints.append(
                found.get("exception", {}).get("description") or found.get("text", "")
            )
        elif method == "Runtime.consoleAPICalled" and given["type"] in ("error", "warning"):
            self.complaints.append(
                " ".join(str(a.get("value", a.get("description"))) for a in given["args"])
            )
        elif method == "Log.entryAdded" and given["entry"]["level"] in ("error", "warning"):
            self.complaints.append(f"{given['entry']['text']} {given['entry'].get('url', '')}")
        elif method == "Network.requestWillBeSent":
            self.requests.append(given["request"]["url"])

    def call(self, method: str, **given: Any) -> Any:
        """Call a method of the browser."""
        return self._send(method, given, False)

    def page(self, method: str, **given: Any) -> Any:
        """Call a method of the page."""
        return self._send(method, given, True)

    def open(self, address: str) -> None:
        """Go to an address."""
        self.page("Page.navigate", url=address)

    def run(self, script: str) -> Any:
        """Value of an expression of the page."""
        found = self.page(
            "Runtime.evaluate", expression=script, awaitPromise=True, returnByValue=True
        )
        if "exceptionDetails" in found:
            raise RuntimeError(found["exceptionDetails"]["exception"]["description"])
        return found["result"].get("value")

    def wait(self, script: str, seconds: float = 60.0) -> Any:
        """Value of an expression as soon as it is true."""
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            with suppress(RuntimeError):  # of a page that is still being loaded
                if value := self.run(f"(v => v instanceof Node ? true : v)({script})"):
                    return value
            time.sleep(0.05)
        raise AssertionError(f"never true: {script}; {self.run('document.body.innerText')[:1500]}")

    def click(self, selector: str) -> None:
        """Click in the middle of an element, once it is at rest there and nothing covers it."""
        place = (
            f"(() => {{ const e = document.querySelector({json.dumps(selector)});"
            " e.scrollIntoView({block: 'nearest'}); const b = e.getBoundingClientRect();"
            " const at = [b.x + b.width / 2, b.y + b.height / 2];"
            " const top = document.elementFromPoint(...at);"
            " return e.contains(top) ? at : null; })()"
        )
        where, end = None, time.monotonic() + 10
        while (now := self.run(place)) is None or now != where:  # answers move what is below them
            if time.monotonic() > end:
                raise AssertionError(f"{selector} is never at rest, or is covered")
            where = now
            time.sleep(0.1)
        self.mouse("mousePressed", *where)
        self.mouse("mouseReleased", *where)

    def mouse(self, kind: str, x: float, y: float, **more: Any) -> None:
        """Let the mouse do something at a place."""
        more = {"button": "left", "clickCount": 1} | more
        self.page("Input.dispatchMouseEvent", type=kind, x=x, y=y, **more)

    def key(self, text: str) -> None:
        """Type text where the cursor is."""
        self.page("Input.insertText", text=text)

    def press(self, key: str, code: int, **more: Any) -> None:
        """Press a key that is no letter, such as ``Tab``, 9."""
        for kind in ("rawKeyDown", "keyUp"):
            self.page("Input.dispatchKeyEvent", type=kind, key=key, code=key,
                      windowsVirtualKeyCode=code, **more)  # fmt: skip

    def picture(self, path: Path) -> Path:
        """Take a picture of the page."""
        data = self.page("Page.captureScreenshot", format="png")["data"]
        path.write_bytes(base64.b64decode(data))
        return path

    def close(self) -> None:
        """End the browser."""
        self._socket.close()
        self._process.terminate()
        try:
            self._process.wait(10)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        self._folder.cleanup()
