"""What a plain simulation misses of real craft, and what the published tables contradict themselves in.

    python3 -m benchmarks.real_diagnosis [--case blueboat-yaw ...] [--max-seconds S] [--no-tables]

Every case is diagnosed on some runs and measured on others. Nothing in the package was set by looking at these numbers.
"""
