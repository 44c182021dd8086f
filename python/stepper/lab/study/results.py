"""Output folder of a study: journal (results of episodes), in_force.json (provenance of the results), tables and documents."""

from __future__ import annotations

import hashlib
import json
import os
from types import TracebackType
from typing import Any

from stepper.lab.study.document import check_pages
from stepper.lab.study.journal import Journal
from stepper.lab.study.study import Study
from stepper.shared.arguments import path_of
from stepper.shared.files import atomic_write

IN_FORCE, JOURNAL = "in_force.json", "journal.sqlite"
"""Names of the files in a study's folder with the provenance of the rows, and with the rows (results of episodes)."""


class Results:
    """Output folder of a study, as a context manager. Until it is closed, its journal is locked for other processes.

    Args:
        study: The study.
        out: Output folder. The files are in OUT/NAME, a subfolder with the name of the study.
    """

    def __init__(self, study: Study, out: str | os.PathLike[str]):
        check_pages()
        self.folder = path_of("out", out) / study.name
        self.journal = Journal(self.folder / JOURNAL, study.name)
        try:
            self._write_in_force(study)
        except BaseException:
            self.journal.close()
            raise

    def _write_in_force(self, study: Study) -> None:
        """Adds the study's provenance (model, versions, digests) as an entry to in_force.json.

        The key of the entry is its SHA-256, shortened.
        """
        file = self.folder / IN_FORCE
        entries: dict[str, Any] = json.loads(file.read_text(encoding="utf-8")) if file.exists() else {}
        text = json.dumps(study.in_force, sort_keys=True, default=str)
        name = hashlib.sha256(text.encode()).hexdigest()[:16]
        if name in entries:
            return
        with atomic_write(file) as stream:
            stream.write((json.dumps(entries | {name: json.loads(text)}, indent=2, sort_keys=True) + "\n").encode())

    def __enter__(self) -> Results:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self.journal.close()
