"""Conversion of array arguments."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray


def array_of(name: str, value: Any) -> NDArray[np.float64]:
    """Array (...) of float64 with the numbers of an array or of nested sequences; `name` is the name of the argument."""
    if type(value) is np.ndarray and value.dtype.kind in "fiu":  # A fast test of the usual type.
        return value.astype(np.float64, copy=False)
    if isinstance(value, np.ma.MaskedArray):
        raise TypeError(f"{name} is a masked array, must be one without a mask: values.filled(0.0) replaces masked numbers by zeros")
    try:
        array = np.asarray(value)
        kind: str = array.dtype.kind if array.size else "f"
        if kind not in "cOSUMm":
            return array.astype(np.float64, copy=False)
    except (TypeError, ValueError):
        kind = ""
    if kind == "c":
        raise TypeError(f"{name} is {value!r}, with complex numbers, must have real ones: values.real has the real parts")
    remedy = "; values.astype(float) converts an array of objects" if kind == "O" and isinstance(value, np.ndarray) else ""
    raise TypeError(f"{name} is {value!r}, must be an array of numbers, with rows of equal length{remedy}")
