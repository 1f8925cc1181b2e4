"""Timings, one `bench_<room>` each; tests never hold any."""
