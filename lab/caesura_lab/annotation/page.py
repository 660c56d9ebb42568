"""The page of `caesura annotate`: signals with the marks on them, driven by the keyboard.

The browser stores the cursor and the shown time range. `AnnotationEditor` applies every edit on the server,
and the whole annotation is sent back: the page shows what would be saved.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

from nicegui import app, ui
from nicegui.element import Element
from nicegui.elements.mixins.text_element import TextElement
from nicegui.events import GenericEventArguments

from caesura_clients.dashboard.server import Address, run
from caesura_clients.dashboard.web_components import WEB
from caesura_lab.annotation.edits import AnnotationEditor, EditError, Entry, milliseconds, segment_at
from caesura_lab.annotation.signals import PlottedSignals
from caesura_lab.annotation.storage import save_annotation
from caesura_lab.ground_truth import KINDS
from caesura_protocol.errors import CaesuraError
from caesura_protocol.number_words import counted
from caesura_protocol.session_time_display import NO_OFFSET, SessionClock

ASSETS = "/assets"
_HEAD = (
    f'<script src="{ASSETS}/theme.js"></script><link rel="stylesheet" href="{ASSETS}/style.css">'
    '<meta name="robots" content="noindex">'
)


TIMES = ("t", "t_alt", "t0", "t1")  # of changepoints and segments
MODULES = {"caesura-dashboard": str(WEB), "caesura-annotate": str(Path(__file__).parent / "web")}


class AnnotationSession(NamedTuple):
    """The annotation that the page edits.

    name: of the recording; path: of the annotation; clock: converts times for display.
    """

    name: str
    path: Path
    editor: AnnotationEditor
    signals: PlottedSignals
    clock: SessionClock = NO_OFFSET

    def run_command(self, command: str, t: float) -> str:
        """Execute a command at a time of the page [s] and return a message. Raises CaesuraError."""
        if command == "save":
            save_annotation(self.editor.document, self.path)
            self.editor.mark_saved()
            return f"saved {self.path}"
        if command == "undo":
            self.editor.undo()
            return "undone"
        t = milliseconds(t + self.clock.start_s)
        try:
            self.editor.edit(command, t)
        except EditError as error:
            raise EditError(self.clock.text(str(error))) from error
        at = segment_at(self.editor.document, t)
        if command in KINDS and at is not None:
            return f"{command} from {self._extent(at)}"
        return f"{command} at {self.clock.shown(t, 3)} s"

    def state(self, message: str = "", *, failed: bool = False) -> dict[str, Any]:
        """Return the payload of the annotation for the browser."""
        document = self.editor.document
        return {
            "window": [self._shown(t) for t in document["window"]],
            "points": [self._as_shown(point) for point in document["changepoints"]],
            "segments": [self._as_shown(segment) for segment in document["segments"]],
            "saved": self.editor.is_saved,
            "stored": self.path.exists(),
            "message": message,
            "failed": failed,
        }

    def _shown(self, t: float) -> float:
        return milliseconds(t - self.clock.start_s) if self.clock.start_s else t

    def _as_shown(self, entry: Entry) -> Mapping[str, Any]:
        return {name: self._shown(value) if name in TIMES else value for name, value in entry.items()}

    def _extent(self, index: int) -> str:
        """Return text on the extent of a segment, and on the changepoints in it."""
        document = self.editor.document
        segment = document["segments"][index]
        within = [
            point
            for point in document["changepoints"]
            if point["level"] == "major" and segment["t0"] < point["t"] < segment["t1"]
        ]
        extent = f"{self.clock.shown(segment['t0'])} to {self.clock.shown(segment['t1'])} s"
        if not within:
            return extent
        over = counted(len(within), "major changepoint")
        return f"{extent}, over {over}: remove the class (0) to divide it there"


class AnnotationView(Element, component="web/annotate.js", esm=MODULES):
    """Signals, marks and keys.

    Emits `command` with a name and a time, each after the reply to the last one.
    """

    def __init__(self, annotation_session: AnnotationSession) -> None:
        super().__init__()
        self._annotation_session = annotation_session
        self._props["signals"] = annotation_session.signals.as_payload(annotation_session.clock.start_s)
        self._props["initial"] = annotation_session.state()
        self.on("command", self._run_command)

    def _run_command(self, event: GenericEventArguments) -> None:
        command = str(event.args["name"])
        message, failed = f"{command} failed: the terminal shows why", True
        try:
            message, failed = self._annotation_session.run_command(command, float(event.args["t"])), False
        except CaesuraError as error:
            message = str(error)
        finally:
            self.run_method("answered", self._annotation_session.state(message, failed=failed))


def serve(annotation_session: AnnotationSession, address: Address) -> None:
    """Serve the page until the process is asked to end."""
    app.add_static_files(ASSETS, WEB)

    @ui.page("/")
    def _page() -> None:
        ui.page_title(f"{annotation_session.name} · Caesura annotate")
        ui.add_head_html(_HEAD)
        TextElement(tag="h1", text=annotation_session.name)
        if words := annotation_session.clock.words:
            TextElement(tag="p", text=f"{words[0].upper()}{words[1:]}; the file has the recording's own.")
        AnnotationView(annotation_session)

    run(address)
