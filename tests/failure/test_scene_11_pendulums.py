"""Scene 11: a double pendulum and a chain of five links, without damping.

Right answer: the energy is constant; and the state is that of a converged DOP853 solution. Orders of convergence and the state after one
second at dt 1e-4 are in reference/test_trajectories.py; here the sweep over time steps that a user may choose.
"""
