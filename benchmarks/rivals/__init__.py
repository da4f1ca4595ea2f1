"""Other tuning rules on ArduPilot's firmware with simulated hulls: ``python3 -m benchmarks.rivals``."""
