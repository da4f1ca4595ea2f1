"""The report of an identification: its record, page and tables."""
