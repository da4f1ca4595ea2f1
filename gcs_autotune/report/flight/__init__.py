"""The report of a flown manoeuvre, and the page of its preview."""
