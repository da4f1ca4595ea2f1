"""The report of a flown manoeuvre, and its preview page."""
