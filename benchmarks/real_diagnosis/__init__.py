"""What a plain simulation lacks of real craft, and where published tables contradict themselves.

    python3 -m benchmarks.real_diagnosis [--case blueboat-yaw ...] [--max-seconds S] [--no-tables]

Every case is diagnosed on some runs and evaluated on others. Nothing in the package was chosen by these numbers.
"""
