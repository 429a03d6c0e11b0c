"""``slipctl open``: the workbench, a page that shows what a file says while it is edited."""

from __future__ import annotations

import argparse
import logging
import threading
import webbrowser

from slipctl.errors import BadInput

log = logging.getLogger("slipctl")


def answer(options: argparse.Namespace, command: str) -> int:
    """Serve the page until Ctrl-C; the first line printed is its whole address."""
    from slipctl.workbench.sources.openings import check_opening, opening_of_name
    from slipctl.workbench.web.server import Server

    if options.port is not None and not 0 <= options.port < 2**16:
        raise BadInput(f"--port {options.port} is no port; write 1024 to 65535")
    opening = opening_of_name(options.name or "", options.files, not options.no_compile)
    server = Server(opening, options.port or 0)
    try:  # while a first process begins to read it
        check_opening(opening)
    except BadInput:
        server.windows.close()
        raise
    print(server.address, flush=True)
    log.info("%s is open on this machine alone; Ctrl-C ends it", opening.name)
    if not options.no_browser:
        threading.Thread(target=webbrowser.open, args=(server.address,), daemon=True).start()
    server.run()
    return 0
