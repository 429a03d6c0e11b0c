"""``slipctl open``: the workbench, a page that shows what a file says while it is edited."""

from __future__ import annotations

import argparse
import logging
import threading
import webbrowser
from pathlib import Path

from slipctl import registry
from slipctl.errors import BadInput
from slipctl.run import store
from slipctl.study.request import Request

log = logging.getLogger("slipctl")

EXAMPLE = "metro.toml"


def answer(options: argparse.Namespace, command: str) -> int:
    """Serve the page until Ctrl-C; the first line printed is its whole address."""
    from slipctl.workbench.web.server import Server
    from slipctl.workbench.web.windows import Opening

    name = options.name or _example()
    if options.port is not None and not 0 <= options.port < 2**16:
        raise BadInput(f"--port {options.port} is no port; write 1024 to 65535")
    allowed = [*options.files, *([name] if name.endswith(".py") else [])]
    for file in allowed:
        if not Path(file).is_file():
            raise BadInput(f"there is no file {file}")
    asked = Request.read(name)
    if not asked.home:
        asked.needs_loop()
    left = name.rpartition(":")[0] or name
    folder = Path(left).parent if left.endswith((".toml", ".py")) else Path()
    opening = Opening(name, str(folder.resolve()), tuple(allowed), not options.no_compile)
    server = Server(opening, options.port or 0)
    try:  # while a first process begins to read it
        if asked.loop:
            _ = asked.declared
        elif not asked.home.endswith(".toml"):  # a file with faults is opened, to mend it
            _ = asked.study
        elif not Path(asked.home).is_file():
            raise BadInput(f"there is no file {asked.home}; slipctl new metro {asked.home} writes"
                           " one")  # fmt: skip
    except BadInput:
        server.windows.close()
        raise
    print(server.address, flush=True)
    log.info("%s is open on this machine alone; Ctrl-C ends it", name)
    if not options.no_browser:
        threading.Thread(target=webbrowser.open, args=(server.address,), daemon=True).start()
    server.run()
    return 0


def _example() -> str:
    """The example of ``slipctl new``, in this folder; written if it is not there."""
    path = Path(EXAMPLE)
    if not path.exists():
        source = registry.folder("models") / "vehicle" / "files" / EXAMPLE
        store.check_file(path)
        store.write_text(path, source.read_text(encoding="utf-8"))
    return EXAMPLE
