"""Benchmarks: one module `bench_<room>` for each room. Tests never measure times."""
