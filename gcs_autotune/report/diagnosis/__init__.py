"""The report of a diagnosis of a simulation: its page, figures, sentences and tables."""
