"""Scene 10: a robot floats in space and moves its limbs.

Right answer: internal torques change neither linear nor angular momentum. In SimBenchmark's version the squared error of linear momentum
after 10 s is 1.1e-3 (kg m/s)^2 for MuJoCo's Euler rule and 3e-13 for its RK4.
"""
