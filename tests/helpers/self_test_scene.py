"""Model and expected digest of the self-test of `stepper.doctor`.

After a change of bits or of the format of saved models, this renews both:

    PYTHONPATH=python:tests/helpers .venv/bin/python tests/helpers/self_test_scene.py
"""

import stepper
from models import mjcf
from stepper.doctor.self_test import DIGEST, SCENE, digest_at

MJCF = mjcf("self_test")
"""A box on a floor, a capsule that rolls off it, and an arm with joint limits, dry friction, a spring and a servo."""


def renew() -> None:
    """Writes the model and the digest of this build, provided that all CPU levels of this machine agree."""
    stepper.load(MJCF).save(SCENE)
    digests = {level: digest_at(level) for level in stepper.doctor.cpu_levels()}
    if len(set(digests.values())) > 1:
        raise SystemExit(f"not written, the CPU levels differ: {digests}")
    DIGEST.write_text(f"{next(iter(digests.values()))}\n", encoding="ascii")


if __name__ == "__main__":
    renew()
    print(f"wrote {SCENE} and {DIGEST}")
