"""The vehicle as manoeuvres fly it: handshake, telemetry in, set-points out, and watch over both."""
