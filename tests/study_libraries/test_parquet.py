"""Tables of studies in Parquet have what those in npz have."""

import numpy as np
import pyarrow.parquet
import stepper
from servo_arm import ARM


def test_a_table_in_parquet_is_the_one_in_npz(tmp_path):
    study = stepper.lab.Study(
        model=ARM,
        name="arm",
        controller="random",
        outcomes=stepper.lab.Outcome(name="angle", measure="joint hinge"),
        parameters={
            "damping": stepper.lab.Parameter("dof_damping", operation="scale", low=0.5, high=1.5),
            "rule": stepper.lab.Parameter("options.integrator", values=("euler", "midpoint")),
        },
        settings={"MuJoCo": {"engine": "mujoco"}},
        seconds=0.1,
        episodes=2,
    )
    assert tmp_path / "arm/table.parquet" in stepper.lab.sweep(study, tmp_path).files
    parquet, npz = pyarrow.parquet.read_table(tmp_path / "arm/table.parquet"), np.load(tmp_path / "arm/table.npz")
    assert parquet.column_names == list(npz)
    for name in npz:
        # NaN of a parameter without a value, and of what MuJoCo does not say, is NaN there too, and words are words.
        np.testing.assert_array_equal(np.array(parquet[name].to_pylist(), npz[name].dtype), npz[name])
        assert parquet[name].null_count == 0
