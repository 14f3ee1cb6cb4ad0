"""The web page of a labelling session: a server for this machine only, whose address holds a random token."""

from __future__ import annotations

import asyncio
import json
import secrets
import webbrowser
from collections.abc import Sequence
from contextlib import ExitStack, suppress
from pathlib import Path
from threading import Thread
from typing import Any

from tornado.httpserver import HTTPServer
from tornado.netutil import bind_sockets
from tornado.web import Application, HTTPError, RequestHandler, StaticFileHandler

from lanes.detections import as_detection
from lanes.drive import DriveSettings, detect_stills
from lanes.errors import LaneError
from lanes.files import locked, translate_write_errors
from lanes.label.curve import label_rows
from lanes.label.session import Session, pick_stills
from lanes.sources import Sources

# Of the marks of a still; a thousand points have 20 kB.
MAX_BODY_BYTES = 1_000_000


def label_stills(sources: Sources, settings: DriveSettings, count: int, *, browser: bool = True) -> str:
    """Label stills, and `count` frames of each video, in the settings' output folder; returns in words what is done."""
    labels = settings.output / "labels.jsonl"
    with ExitStack() as session_is_open:
        with translate_write_errors(labels):
            settings.output.mkdir(parents=True, exist_ok=True)
            session_is_open.enter_context(locked(settings.output / "labels.session.lock"))
        picked = [still for video in sources.videos for still in pick_stills(video, settings, count)]
        session = Session(settings.output, [*sources.stills, *picked])
        with suppress(KeyboardInterrupt):
            asyncio.run(_serve(session, settings, browser))
    return f"{sum(session.saved())} of {len(session.stills)} stills have a label in {labels}"


async def _serve(session: Session, settings: DriveSettings, browser: bool) -> None:
    root, ended, found = f"/{secrets.token_urlsafe()}", asyncio.Event(), dict[Path | None, Any]()
    search = Thread(target=_find_our_lines, args=(session.stills, settings, found), daemon=True)

    def ours(k: int) -> dict[str, Any]:
        if not session.saved()[k]:
            return {"error": "Save the label first: it must not depend on our lines."}
        if not search.ident:
            search.start()
        if session.stills[k] in found:
            session.compare(k)
        return found.get(session.stills[k]) or found.get(None) or {}

    get = {"still": session.label, "proposal": session.propose, "ours": ours}
    pages = Application(log_function=lambda _: None, get=get, session=session, ended=ended)
    page = rf"{root}/(label\.(?:html|css|js))", Page, {"path": Path(__file__).parent}
    # No other host: another site could give its own name the address of this machine (DNS rebinding).
    pages.add_handlers(r"127\.0\.0\.1", [page, (rf"{root}/(still|picture|proposal|ours|end)/(\d+)", Answer)])
    (socket,) = bind_sockets(0, "127.0.0.1")
    HTTPServer(pages, max_body_size=MAX_BODY_BYTES).add_socket(socket)
    print(f"the page is at {(address := f'http://127.0.0.1:{socket.getsockname()[1]}{root}/label.html')}", flush=True)
    if browser:
        Thread(target=webbrowser.open, args=(address,), daemon=True).start()
    await ended.wait()


def _find_our_lines(stills: Sequence[Path], settings: DriveSettings, found: dict[Path | None, Any]) -> None:
    """Put the detection in each still into `found`, by path; in the end, as None, a sentence for stills without."""
    failures: list[Any] = []
    try:
        for still in detect_stills(stills, settings, failures):
            lane, camera, rows = still.detection.lane, still.detection.camera, label_rows(len(still.image))
            found[still.path] = as_detection(lane, camera, rows, still.run_time_ms)
    except Exception as error:  # labelling goes on without a comparison
        failures.append(error)
    found[None] = {"error": " ".join(map(str, ["Our lines cannot be shown.", *failures]))}


class Page(StaticFileHandler):
    """The files of the page."""

    def set_default_headers(self) -> None:
        self.set_header("X-Content-Type-Options", "nosniff")


class Answer(RequestHandler):
    """GET: label, picture, proposal or our lines of a still. POST: marks of a still, or the end."""

    def set_default_headers(self) -> None:
        # Whatever a file in the folder is, the browser must not run it as a page of this server.
        self.set_header("X-Content-Type-Options", "nosniff")
        self.set_header("Cache-Control", "no-store")

    def get(self, what: str, number: str) -> None:
        still = self._require_still(number)
        if what == "end":
            raise HTTPError(404)
        if what != "picture":
            self.write(self.settings["get"][what](still))
            return
        picture = self.settings["session"].stills[still]
        suffix = picture.suffix.lower().removeprefix(".")
        self.set_header("Content-Type", f"image/{'jpeg' if suffix.startswith('j') else suffix}")
        self.write(picture.read_bytes())

    def post(self, what: str, number: str) -> None:
        if what == "end":
            asyncio.get_running_loop().call_later(0.1, self.settings["ended"].set)  # after the answer
            return
        still, marks = self._require_still(number), self._read_marks()
        self.write(self.settings["session"].mark(still, **marks))

    def _require_still(self, number: str) -> int:
        if len(number) > 9 or int(number) >= len(self.settings["session"].stills):
            raise HTTPError(404)
        return int(number)

    def _read_marks(self) -> dict[str, Any]:
        try:
            marks = json.loads(self.request.body)
        except (ValueError, RecursionError):
            marks = None
        if not isinstance(marks, dict) or marks.keys() != {"points", "save"}:
            raise LaneError("Marks are a JSON object with points and save.")
        return marks

    def write_error(self, status_code: int, **more: Any) -> None:
        """A sentence, which the page shows; 400 for marks or a picture that cannot be used."""
        error = more["exc_info"][1]
        self.set_header("Content-Type", "text/plain; charset=utf-8")
        if isinstance(error, LaneError | OSError):
            self.set_status(400 if isinstance(error, LaneError) else 500)
            text = str(error)
        else:
            text = "There is no such still." if status_code == 404 else "The server failed; start it again."
        self.finish(text)

    def log_exception(self, *_: Any) -> None: ...
