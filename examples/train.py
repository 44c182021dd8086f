"""Script form of the command `stepper train`: proximal policy optimisation (PPO) by python/stepper/policies/ppo.py.

Usage:

    python examples/train.py stepper/HalfCheetah-v5 --seed 1 --film half_cheetah.mp4
"""

if __name__ == "__main__":
    print("stepper train: importing PyTorch", flush=True)
    from stepper.policies.ppo import main

    main()
