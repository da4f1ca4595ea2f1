"""The vehicle's parameters: asked for, written and read back; changed for a while, with a journal on disk."""
