"""Recordings: inputs and results of a simulation on disk, and replays that compare them bit for bit."""

from typing import Any

from stepper._hints import no_name
from stepper.recording.format import HEADER, RecordingError, RecordingWarning
from stepper.recording.recorder import Recorder
from stepper.recording.segments import Segment, segments
from stepper.recording.verify import Difference, Verification, verify

__all__ = ["HEADER", "Difference", "Recorder", "RecordingError", "RecordingWarning", "Segment", "Verification", "segments", "verify"]


def __getattr__(name: str) -> Any:
    raise no_name(__name__, name, __all__)
