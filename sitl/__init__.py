"""An ArduRover/ArduSub-style vehicle in a simulated sea, speaking MAVLink 2. Knows nothing of the tuner."""
