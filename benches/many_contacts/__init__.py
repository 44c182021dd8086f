"""Benchmark of scenes with many contacts: standing robots, grasping hands, heaps and walls, in stepper and in `mujoco.batch`."""
