"""The vehicle as manoeuvres see it: handshake, telemetry, set-points, and monitors of both."""
