"""Effect of stiffer friction (impratio) and smaller time steps on the slip of cubes at a friction of 0.46, in both engines.

Usage:

    stepper sweep examples/studies/panda_impratio.py --no-cliffs
"""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path

import stepper

sys.path.insert(0, str(Path(__file__).resolve().parent))

from panda_cones import study as cones  # type: ignore[import-not-found]

study = replace(
    cones,
    name="panda_impratio",
    parameters={
        "friction": replace(cones.parameters["friction"], values=(0.46,), nominal=0.46),
        "impratio": stepper.lab.Parameter("impratio", values=(1.0, 10.0, 100.0), source="MuJoCo's guide against slip: 10 to 100"),
        "time step": stepper.lab.Parameter("options.timestep", values=(0.002, 0.001, 0.0005), unit="s"),
    },
    settings={name: cones.settings[name] for name in ("MuJoCo's law, elliptic", "MuJoCo, elliptic", "MuJoCo, pyramidal")},
)
