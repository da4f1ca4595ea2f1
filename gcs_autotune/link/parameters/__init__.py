"""The vehicle's parameters: read, write and verify; temporary changes with a journal on disk."""
