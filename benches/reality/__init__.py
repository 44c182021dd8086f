"""Engines against measurements of real motions: `make reality`. The page is docs/benchmarks/reality.md."""
