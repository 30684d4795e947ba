"""What all open windows share: the project, what has been read and computed, the job that runs.

Everything here is changed by the one thread of the server, in event handlers and in ``tick``: two windows see the same
state and cannot tear it. ``revision`` grows with every change that a view has to show.
"""

from __future__ import annotations

import time
from collections import deque
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

from pneuid.errors import UserError
from pneuid.workbench.jobs import Job, Worker
from pneuid.workbench.payload import ComparisonView, EffectCard, ParameterRow, RawPreview, RunData, SignatureView
from pneuid.workbench.project import RIG, Project, RunFile, write
from pneuid.workbench.request import FitRequest
from pneuid.workbench.security import LARGEST_RUN, LARGEST_UPLOAD

READING, COMPUTING = "pneuid.workbench.reading", "pneuid.workbench.computing"
LOOK_SECONDS = 2.0
"""How often the folder is looked at for what commands have written."""

READ_SECONDS, READ_SECONDS_PER_MB = 60.0, 1.0
"""Longest time that a file may take to be read: a damaged one can hold its reader for ever."""

_LARGE = 8 * 2**20

Kind = Literal["positive", "negative", "warning", "info"]


@dataclass
class Selection:
    """What a fit starts from, shared by the windows."""

    effects: list[str] = field(default_factory=list)
    friction: str | None = None
    start: dict[str, float] = field(default_factory=dict)


class Workbench:
    """One project being worked on."""

    def __init__(self, project: Project, limit: int = LARGEST_UPLOAD) -> None:
        self.project, self.limit = project, limit
        self.reader = Worker("reader", (READING,))
        self.computer = Worker("computer", (COMPUTING,))
        self.revision = 0
        self.files: list[RunFile] = []
        self.data: dict[str, RunData] = {}
        self.faults: dict[str, str] = {}
        self.zeros: dict[str, str] = {}
        self.doubts: tuple[str, ...] = ()
        self.refused: dict[str, str] = {}
        self.rig_fault = ""
        self.head: RawPreview | None = None
        self.model = ""
        self.comparisons: dict[str, ComparisonView] = {}
        self.cards: dict[str, EffectCard] = {}
        self.laws: tuple[str, ...] = ()
        self.signatures: dict[str, SignatureView | None] = {}
        self.parameters: list[ParameterRow] = []
        self.selection = Selection()
        self.job: Job | None = None
        self.said: deque[tuple[int, str, Kind]] = deque(maxlen=20)
        self._said = 0
        self._seen: dict[str, tuple[int, int, bool]] = {}
        self._print: Any = None
        self._looked = 0.0
        self._doubtful = False

    # --- life ---

    def open(self) -> None:
        """Look at the folder and start reading."""
        self.look()

    def tick(self) -> None:
        """Take in what the processes say; look at the folder now and then."""
        if self.reader.poll() | self.computer.poll():
            self.changed()
        if self._doubtful and not self.reader.busy:
            self._doubtful = False
            self._doubt()
        if time.monotonic() - self._looked > LOOK_SECONDS:
            self.look()

    def close(self) -> None:
        """End the processes."""
        self.reader.stop()
        self.computer.stop()

    def changed(self) -> None:
        """Every window shows the state again; while a job runs only its progress has changed."""
        job = self.computer.current
        if job is None or job.over or self.reader.busy:
            self.revision += 1

    def say(self, message: str, kind: Kind = "negative") -> None:
        """A message for every window."""
        self._said += 1
        self.said.append((self._said, message, kind))

    # --- runs ---

    def look(self) -> None:
        """Read what is new or changed in the folder."""
        self._looked = time.monotonic()
        found = self.project.fingerprint()
        if found == self._print:
            return
        rig_changed = self._print is None or found[1] != self._print[1]
        self._print = found
        self.files = self.project.runs()
        names = {run.name for run in self.files}
        for gone in set(self._seen) - names:
            del self._seen[gone]
            self._forget(gone)
        if rig_changed:
            self._seen.clear()
            self.comparisons.clear()
            self.signatures.clear()
            if self.project.has_rig:
                self._learn()
        if self.project.has_rig:
            stamps = {run.name: (run.size, run.changed, run.role == "zero") for run in self.files}
            fresh = [run for run in self.files if self._seen.get(run.name) != stamps[run.name]]
            self._seen.update(stamps)
            for run in fresh:
                self._read(run)
            self._doubtful |= bool(fresh)
        models = self.project.models()
        if self.model not in models:
            self.model = models[-1] if models else ""
        self.revision += 1

    def _read(self, run: RunFile) -> None:
        arguments = {"path": self.project.path(run.name), "rig_text": self.project.rig_text()}

        def read(found: RunData | None) -> None:
            if found is not None:
                self.data[run.name] = found
                self.faults.pop(run.name, None)

        def failed(message: str) -> None:
            self._forget(run.name)
            self.faults[run.name] = self._short(message)

        def read_zero(words: str) -> None:
            self._forget(run.name)
            self.zeros[run.name] = words

        if run.role == "zero":
            self._on_file(f"reading {run.name}", "read_zero", arguments, then=read_zero, otherwise=failed)
            return
        self.zeros.pop(run.name, None)

        if run.size > LARGEST_RUN:
            failed(
                f"{run.name}: {run.size / 2**30:.1f} GB is more than the 1 GB a run may have; cut it into several runs"
            )
            return
        if run.size > _LARGE:
            self._on_file(f"a first look at {run.name}", "preview_run", arguments, then=read)
        self._on_file(f"reading {run.name}", "read_run", arguments, then=read, otherwise=failed)

    def _forget(self, name: str) -> None:
        """Drop what is known of a file."""
        for known in (self.data, self.faults, self.zeros):
            known.pop(name, None)

    def _on_file(self, title: str, name: str, arguments: dict[str, Any], **more: Any) -> None:
        """Have the reading process do something with one file, which may end the process, or keep it for ever."""
        path: Path = arguments["path"]
        limit = READ_SECONDS + READ_SECONDS_PER_MB * (path.stat().st_size / 2**20 if path.exists() else 0.0)
        self.reader.submit(
            title, READING, name, arguments, limit=limit, **more,
            crashed=f"{path.name}: its reader crashed; the file is damaged, or not what its ending says",
            slow=f"{path.name}: not read within {limit:.0f} s; the file is damaged, or too long: cut it into several runs",
        )  # fmt: skip

    def _doubt(self) -> None:
        """Have the usable runs looked at together, the very large ones apart."""
        used = [run for run in self.files if run.role != "unused" and run.size < _LARGE and run.name in self.data]
        paths = [self.project.path(run.name) for run in used]
        arguments = {"paths": paths, "rig_text": self.project.rig_text()}

        def doubted(found: tuple[str, ...]) -> None:
            self.doubts = found

        self.reader.submit("looking for slips", READING, "doubts", arguments, then=doubted)

    def _short(self, message: str) -> str:
        """A message without the folder that everyone knows."""
        return (
            message.replace(f"{self.project.folder}/.incoming/", "")
            .replace(f"{self.project.folder}/", "")
            .splitlines()[0]
        )

    def _learn(self) -> None:
        def learnt(found: tuple[list[EffectCard], tuple[str, ...]]) -> None:
            self.cards, self.laws = {card.name: card for card in found[0]}, found[1]
            self.rig_fault = ""

        def failed(message: str) -> None:
            self.rig_fault = self._short(message)

        self.reader.submit(
            "checking rig.toml", READING, "check_rig", {"text": self.project.rig_text()},
            then=lambda _: setattr(self, "rig_fault", ""), otherwise=failed, first=True,
        )  # fmt: skip
        self.computer.submit("the catalogue", COMPUTING, "catalogue", {"folder": self.project.folder}, then=learnt)
        self.refresh_parameters()

    def refresh_parameters(self) -> None:
        """Learn which parameters the chosen model would have."""
        arguments = {
            "folder": self.project.folder,
            "effects": list(self.selection.effects),
            "friction": self.selection.friction,
        }

        def learnt(found: list[ParameterRow]) -> None:
            self.parameters = found

        self.computer.submit(
            "its parameters", COMPUTING, "parameters", arguments, then=learnt, otherwise=self._complain
        )

    def ask_signature(self, name: str) -> None:
        """Learn how an effect shows on this rig; ``signatures`` holds it later."""

        def learnt(found: SignatureView | None) -> None:
            self.signatures[name] = found

        arguments = {"folder": self.project.folder, "name": name}
        self.computer.submit(
            f"the signature of {name}", COMPUTING, "signature_view", arguments, then=learnt, otherwise=self._complain
        )

    def _complain(self, message: str) -> None:
        self.say(self._short(message))

    def uploaded(self, name: str, waiting: Path) -> None:
        """Check an upload in its waiting place, then take it in or refuse it."""
        rig = self.project.rig_text() if self.project.has_rig else None

        def checked(hint: str) -> None:
            self.project.accept(waiting)
            self.refused.pop(name, None)
            if hint:
                self.say(f"added, but not usable yet: {self._short(hint)}", "warning")
            else:
                self.say(f"{name} added", "positive")
            self.look()

        def failed(message: str) -> None:
            waiting.unlink(missing_ok=True)
            self.refuse(name, self._short(message))

        arguments = {"path": waiting, "rig_text": rig}
        self._on_file(f"checking {name}", "check_upload", arguments, then=checked, otherwise=failed)

    def refuse(self, name: str, message: str) -> None:
        """Keep why an upload was refused until it is read."""
        self.refused[name] = message
        self.revision += 1

    def look_at_head(self, name: str, layout: dict[str, Any] | None = None) -> None:
        """Fetch the head of a file as it stands, for mapping its columns; ``layout``: keys of ``[files]`` to read it with."""
        self.head = None
        rig = self.project.rig_text() if self.project.has_rig else None

        def found(head: RawPreview) -> None:
            self.head = head

        arguments = {"path": self.project.path(name), "rig_text": rig, "layout": layout}
        self._on_file(f"the head of {name}", "raw_head", arguments, then=found, otherwise=self._complain, first=True)

    def save_rig(self, text: str) -> None:
        """Check rig.toml and write it where it can be used."""

        def good(_: None) -> None:
            write(self.project.folder / RIG, text)
            self.rig_fault = ""
            self.say("rig.toml saved", "positive")
            self.look()

        self.reader.submit(
            "checking rig.toml", READING, "check_rig", {"text": text}, then=good, otherwise=self._complain
        )

    # --- long jobs ---

    def _long(self, title: str, name: str, arguments: dict[str, Any], live: tuple[str, ...], then: Any) -> None:
        """Start a long job. Raises ``UserError`` while another one runs."""
        if self.job is not None and not self.job.over:
            raise UserError(f"a job is running already ({self.job.title}); wait for it or cancel it")
        if not self.project.has_rig:
            raise UserError("there is no rig.toml yet; describe the rig in the Data view first")
        for run in self.files:
            if run.role != "unused" and run.name in self.faults:
                raise UserError(f"{self.faults[run.name]}; mend it, or give it the role 'not used' in the Data view")

        def failed(message: str) -> None:
            if message != "cancelled":
                self.say(self._short(message))
            else:
                self.say(f"{title}: cancelled", "info")

        self.job = self.computer.submit(title, COMPUTING, name, arguments, live, then=then, otherwise=failed)
        self.revision += 1

    def fit(self, add: tuple[str, ...] = (), parent: str = "", diagnosis: str = "") -> None:
        """Fit the chosen model, or ``parent`` with ``add`` (the ladder grows a rung). Raises ``UserError``."""
        train, held = tuple(self.project.of_role("train")), tuple(self.project.of_role("hold_out"))
        if parent:
            request = FitRequest(self.project.folder, train, held, add, parent=parent, added=", ".join(add) or None,
                                 diagnosis=diagnosis or None)  # fmt: skip
            title = f"fit with {', '.join(add)}"
        else:
            chosen = self.selection
            request = FitRequest(
                self.project.folder, train, held, tuple(chosen.effects), chosen.friction, dict(chosen.start)
            )
            title = "fit"
        if not train:
            raise UserError("no run has the role 'train'; give at least one run that role in the Data view")

        def fitted(found: tuple[str, ComparisonView]) -> None:
            self.model = found[0]
            self.comparisons[found[0]] = found[1]
            self.say(f"{title}: done", "positive")
            self.look()

        self._long(title, "fit", {"request": request}, ("monitor", "say"), fitted)

    def _on_runs(self) -> dict[str, Any]:
        return {
            "folder": self.project.folder, "name": self.model, "train": self.project.of_role("train"),
            "held": self.project.of_role("hold_out"),
        }  # fmt: skip

    def compare(self) -> None:
        """Simulate the chosen model against the runs. Raises ``UserError``."""
        name = self.model

        def compared(found: ComparisonView) -> None:
            self.comparisons[name] = found

        self._long(f"compare {name}", "compare", self._on_runs(), ("say",), compared)

    def diagnose(self) -> None:
        """Diagnose the chosen model. Raises ``UserError``."""

        def diagnosed(_: str) -> None:
            self.say("diagnosis: done", "positive")
            self.look()

        arguments = self._on_runs() | {"zero": self.project.of_role("zero")}
        self._long(f"diagnose {self.model}", "diagnose", arguments, ("monitor", "say"), diagnosed)

    def draw_shapes(self, diagnosed: str) -> None:
        """Lay the leading effects of a diagnosis over the defect that its model leaves. Raises ``UserError``."""
        arguments = {"folder": self.project.folder, "name": self.model, "train": self.project.of_role("train"),
                     "diagnosed": diagnosed}  # fmt: skip
        self._long(f"shapes of {diagnosed}", "draw_shapes", arguments, ("monitor", "say"), lambda _: self.look())

    def report(self) -> None:
        """Write report.html of the chosen model. Raises ``UserError``."""

        def written(path: str) -> None:
            self.say(f"written: {path}", "positive")

        self._long(f"report of {self.model}", "write_report", self._on_runs(), ("say",), written)

    def cancel(self) -> None:
        """Cancel the running job."""
        if self.job is not None and not self.job.over:
            self.computer.cancel(self.job)

    def diagnosis(self) -> tuple[str, dict[str, Any]] | None:
        """The newest diagnosis, of the chosen model where one says so, and its folder."""
        found = [(name, self.project.result(name, "diagnosis.json")) for name in self.project.diagnoses()]
        usable = [(name, item) for name, item in found if isinstance(item, dict) and "ranking" in item]
        own = [pair for pair in usable if pair[1].get("model", self.model) == self.model]
        return (own or usable)[-1] if usable else None
