"""The report of a diagnosis: its page, pictures, sentences and tables."""
