"""Recordings: inputs and results of a simulation on disk, and replays that compare them bit for bit."""

from stepper.recording.format import HEADER, RecordingError, RecordingWarning
from stepper.recording.recorder import Recorder
from stepper.recording.segments import Segment, segments
from stepper.recording.verify import Difference, Verification, verify

__all__ = ["HEADER", "Difference", "Recorder", "RecordingError", "RecordingWarning", "Segment", "Verification", "segments", "verify"]
