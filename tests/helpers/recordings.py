"""A pendulum to record, recordings changed by hand with valid checksums, and a limit of file sizes, which stands for a full disk."""

import contextlib
import io
import json
from collections.abc import Iterator

import numpy as np
import pytest
from stepper.recording.format import FIRST_DIGEST, KINDS, ROWS, append_block, archive_of, find_blocks, read_header, write_header

PENDULUM = """
<mujoco><option timestep="0.002"/>
  <worldbody><body><joint name="pivot" type="hinge" axis="0 1 0"/><geom type="capsule" fromto="0 0 0 0 0 -.5" size=".05"/>
  <site name="imu"/></body></worldbody><actuator><motor joint="pivot"/></actuator>
  <sensor><jointpos name="angle" joint="pivot"/><gyro name="gyro" site="imu"/><accelerometer name="acceleration" site="imu"/></sensor>
</mujoco>"""
"""MJCF of a pendulum with a motor and sensors."""


def edit_header(folder, change):
    """Changes run.json by `change(head)`, with a checksum that is right."""
    head = json.loads((folder / "run.json").read_text())
    change(head)
    write_header(folder, head)


def edit_file(folder, change):
    """Changes the arrays of all rows, joined to one block, by `change(arrays)`, with checksums that are right."""
    arrays = joined(folder)
    kinds = arrays["kind"].tolist()
    change(arrays)
    rows, steps = len(kinds), kinds.count(KINDS.index("step"))
    with (folder / ROWS).open("wb") as file:
        digest = append_block(file, archive_of(arrays), rows, steps, FIRST_DIGEST)
        size = file.tell()
    edit_header(folder, lambda head: head.update(rows=rows, steps=steps, size=size, digest=digest.hex()))


def joined(folder):
    """Arrays of all rows by name, as if the recording had one block: a slow machine writes more blocks."""
    data = (folder / ROWS).read_bytes()
    kinds, steps, others = [], {}, {}
    for block in find_blocks(folder, read_header(folder)):
        arrays = dict(np.load(io.BytesIO(data[block.start : block.end])))
        for name, values in arrays.items():
            row, slash, argument = name.partition("/")
            if slash:
                others[f"{len(kinds) + int(row)}/{argument}"] = values
            elif name != "kind":
                steps.setdefault(name, []).extend(values)
        kinds += arrays["kind"].tolist()
    return {"kind": np.array(kinds, np.uint8), **{name: np.array(values) for name, values in steps.items()}, **others}


@contextlib.contextmanager
def disk_of(size: int) -> Iterator[None]:
    """Make the operating system refuse to write more than `size` bytes to a file."""
    resource = pytest.importorskip("resource")
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
