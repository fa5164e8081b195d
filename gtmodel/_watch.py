"""``gtmodel watch``: solve a problem again when one of its files changes, and show its report in a browser.

The server answers this machine alone: it is bound to 127.0.0.1, and refuses requests that name another host.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from html import escape
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

from gtmodel._report import asked
from gtmodel.problem_files import python_models, run
from gtmodel.problem_files.base import InputError
from gtmodel.problem_files.files import find
from gtmodel.problem_files.load import load
from gtmodel.results.page.page import page
from gtmodel.results.written import sha256_of_file

HERE = "127.0.0.1"
EVERY_S = 0.4  # between two looks at the files
_RELOAD = (
    "<script>const seen='%d';setInterval(async()=>{try{const r=await fetch('/number');"
    "if(await r.text()!==seen)location.reload()}catch{}},600)</script>"
)


class FollowedProblem:
    """The report of a problem, solved again by `look` if a file has changed since the last time."""

    def __init__(self, problem: str, settings: Sequence[str] = ()) -> None:
        self.problem, self.settings = problem, tuple(settings)
        self.number = 0
        self.text = _page(f"{problem}: being solved", 0)
        self._files: dict[Path, str] = {}

    def look(self) -> str:
        """Return a sentence about the new report; "" if no file has changed."""
        if self.number and self._files == {path: sha256_of_file(path) for path in self._files}:
            return ""
        began, paths = time.monotonic(), [find(self.problem)[0]] if not self.number else [*self._files]
        self._files = {path: sha256_of_file(path) for path in paths}
        try:
            loaded = load(self.problem, self.settings)
            context = run.context_of(loaded)
            try:
                study = run.solve(loaded, context).outcome
            finally:
                paths = list(dict.fromkeys([loaded.path, *context.inputs.values()]))
                self._files |= {path: sha256_of_file(path) for path in paths if path not in self._files}
            text, message = page(study, asked(loaded, context)), f"{study.status.value}: {study.message}"
        except Exception as error:
            _, message = python_models.describe(error, self.problem)
            text = ""
        self.number += 1
        self.text = text.replace("</body>", _RELOAD % self.number + "</body>") or _page(message, self.number)
        return f"{message} ({time.monotonic() - began:.1f} s)"


def _page(sentence: str, number: int) -> str:
    """A page that says a sentence, until there is another one."""
    body = f"<body><p>{escape(sentence)}</p>{_RELOAD % number}</body>"
    return f'<!DOCTYPE html><html lang="en"><meta charset="utf-8">{body}</html>'


@contextmanager
def serving(watched: FollowedProblem, port: int = 0) -> Iterator[str]:
    """Serve the report on this machine inside the block; yields its address. Raises InputError if the port is taken."""

    class Handler(BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            host = self.headers.get("Host", "").rpartition(":")[0]
            texts = {"/": watched.text, "/number": str(watched.number), "/favicon.ico": ""}
            status = 403 if host not in (HERE, "localhost") else 200 if self.path in texts else 404
            body = texts[self.path].encode() if status == 200 else b""
            self.send_response(status)
            self.send_header("Content-Type", f"text/{'html' if self.path == '/' else 'plain'}; charset=utf-8")
            self.send_header("Content-Length", str(len(body)))
            self.end_headers()
            self.wfile.write(body)

        def log_message(self, format: str, *_: object) -> None:
            pass

    try:
        server = ThreadingHTTPServer((HERE, port), Handler)
    except OSError as error:
        raise InputError(f"--port {port} cannot be used: {error.strerror}; --port 0 takes a free one") from error
    thread = threading.Thread(target=server.serve_forever, args=(0.1,), daemon=True)
    thread.start()
    try:
        yield f"http://{HERE}:{server.server_address[1]}/"
    finally:
        server.shutdown()
        server.server_close()


def watch(problem: str, settings: Sequence[str], port: int, tell: Callable[[str], object]) -> None:
    """Solve, serve and look again until Ctrl-C. Raises InputError if there is no such problem."""
    watched = FollowedProblem(problem, settings)
    find(problem)  # before a page is shown
    with serving(watched, port) as address:
        tell(f"{address} shows the report and follows the file; Ctrl-C ends")
        try:
            tell(watched.look())
            while True:
                time.sleep(EVERY_S)
                if sentence := watched.look():
                    tell(sentence)
        except KeyboardInterrupt:
            pass
