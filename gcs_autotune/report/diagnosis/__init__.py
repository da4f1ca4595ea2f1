"""The report of a diagnosis: its page, figures, sentences and tables."""
