"""The vehicle as used by manoeuvres: handshake, telemetry and set-points, with their monitoring."""
