"""Recordings: inputs and results of a simulation on disk, and replays that compare them bit for bit."""

from typing import Any

from stepper._hints import no_name
from stepper.recording.format import HEADER, RecordingError, RecordingWarning
from stepper.recording.recorder import Recorder
from stepper.recording.replay import Difference, Replay, replay
from stepper.recording.segments import Segment, segments

__all__ = ["HEADER", "Difference", "Recorder", "RecordingError", "RecordingWarning", "Replay", "Segment", "replay", "segments"]


def __getattr__(name: str) -> Any:
    raise no_name(__name__, name, __all__)
