"""Workers that have other versions than the process that asks them are refused, and the error names both."""

import os

import numpy as np
import pytest
import ray
import stepper
from stepper.lab.study.jobs import WorkerVersionError

ARM = (
    """<mujoco><worldbody><body><joint name="hinge" axis="0 1 0" damping="1"/><geom size=".05" pos=".2 0 0"/></body></worldbody></mujoco>"""
)


@pytest.mark.parametrize(("module", "version"), [("numpy", "2.0.99"), ("stepper", "0.0.1")])
def test_a_worker_with_another_version_is_refused(tmp_path, module, version):
    # What Python imports at its start: of the workers alone, since they alone have its folder on their path.
    folder = tmp_path / "site"
    folder.mkdir()
    (folder / "sitecustomize.py").write_text(f"import {module}\n{module}.__version__ = '{version}'\n")
    path = os.pathsep.join([str(folder), os.environ.get("PYTHONPATH", "")])
    ray.init(num_cpus=1, include_dashboard=False, log_to_driver=False, runtime_env={"env_vars": {"PYTHONPATH": path}})
    try:
        study = stepper.lab.Study(model=ARM, seconds=0.1, ray=True, outcomes=stepper.lab.Outcome(name="angle", measure="joint hinge"))
        ours = {"numpy": np.__version__, "stepper": stepper.__version__}[module]
        with pytest.raises(WorkerVersionError, match=rf"has {module} {version} there and {ours} here, so that its rows") as told:
            stepper.lab.sweep(study, tmp_path)
        assert str(told.value).count(" there and ") == 1
    finally:
        ray.shutdown()
