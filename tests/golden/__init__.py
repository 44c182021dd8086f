"""Trajectories whose bits are kept in the repository: `golden.json` has their digests."""
