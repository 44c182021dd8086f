"""Output folder of a study: journal (results of episodes), resolved_settings.json (provenance of the results), tables and documents."""

from __future__ import annotations

import contextlib
import hashlib
import json
import os
from types import TracebackType
from typing import Any

from stepper.lab.study.document import check_pages
from stepper.lab.study.journal import Journal
from stepper.lab.study.study import Study
from stepper.shared.arguments import path_of
from stepper.shared.files import explained, locked, write_text

SETTINGS, JOURNAL = "resolved_settings.json", "journal.sqlite"
"""Names of the files in a study's folder with the provenance of the rows, and with the rows (results of episodes)."""


class Results:
    """Output folder of a study, as a context manager. Until it is closed, it is locked for other runs.

    Args:
        study: The study.
        out: Output folder. The files are in OUT/NAME, a subfolder with the name of the study.

    Raises:
        BlockingIOError: Another run writes to the folder.
        JournalError: The journal cannot be used.
    """

    def __init__(self, study: Study, out: str | os.PathLike[str]):
        check_pages()
        self.folder = path_of("out", out) / study.name
        with contextlib.ExitStack() as opened:
            opened.enter_context(locked(self.folder))
            self.journal = opened.enter_context(Journal(self.folder / JOURNAL, study.name))
            self._write_settings(study)
            self._opened = opened.pop_all()

    def _write_settings(self, study: Study) -> None:
        """Adds the study's provenance (model, versions, digests) as an entry to resolved_settings.json.

        The key of the entry is its SHA-256, shortened.
        """
        file = self.folder / SETTINGS
        with explained(file, "restore the file, or delete it with the journal to run the study from the start"):
            entries: dict[str, Any] = json.loads(file.read_text(encoding="utf-8")) if file.exists() else {}
        text = json.dumps(study.resolved_settings(), sort_keys=True, default=str)
        name = hashlib.sha256(text.encode()).hexdigest()[:16]
        if name in entries:
            return
        write_text(file, json.dumps(entries | {name: json.loads(text)}, indent=2, sort_keys=True) + "\n")

    def __enter__(self) -> Results:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self._opened.close()
