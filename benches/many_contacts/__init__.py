"""Speed where contacts are many: robots that stand, hands and grippers that hold, heaps and walls, in stepper and beside `mujoco.batch`."""
