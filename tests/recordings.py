"""Recordings changed by hand, as whoever wants to deceive a checksum would change them."""

import io
import json

import numpy as np
from stepper.recording.format import FIRST_DIGEST, KINDS, ROWS, append_block, archive_of, find_blocks, read_header, write_header


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
