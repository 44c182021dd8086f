"""Humanoids beside MuJoCo without the charts: prints the demo's table, writes humanoid figures to demo.json."""

from __future__ import annotations

import argparse
from pathlib import Path

from stepper.experiments.demo import Plan, demo


def main() -> None:
    """Reads the arguments and measures."""
    plan = Plan()
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--num-envs", type=int, default=plan.num_envs, help="humanoids in stepper")
    parser.add_argument("--peers", type=int, default=None, help="humanoids in MuJoCo; default: a quarter")
    parser.add_argument("--steps", type=int, default=plan.steps, help="steps of random control")
    parser.add_argument("--rest", type=int, default=plan.rest, help="steps without control after that")
    parser.add_argument("--seed", type=int, default=plan.seed, help="of the random control")
    parser.add_argument("--out", type=Path, default=Path("out"), help="folder; default: out")
    args = vars(parser.parse_args())
    out = args.pop("out")
    demo(Plan(**args), out, with_charts=False)


if __name__ == "__main__":
    main()
