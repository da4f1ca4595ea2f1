"""Against the rivals, on ArduPilot's own firmware with our hydrodynamics: ``python3 -m benchmarks.rivals``."""
