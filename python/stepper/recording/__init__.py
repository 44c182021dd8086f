"""Recordings: everything that happened, written down, and repeated bit for bit."""

from stepper.recording.format import RecordingError
from stepper.recording.recorder import Recorder
from stepper.recording.replay import Difference, Replay, replay

__all__ = ["Difference", "Recorder", "RecordingError", "Replay", "replay"]
