"""`stepper train` as a script: proximal policy optimisation, whose learner is python/stepper/policies/ppo.py.

python examples/train.py stepper/HalfCheetah-v5 --seed 1 --film half_cheetah.mp4
"""

if __name__ == "__main__":
    print("stepper train: importing PyTorch", flush=True)
    from stepper.policies.ppo import main

    main()
