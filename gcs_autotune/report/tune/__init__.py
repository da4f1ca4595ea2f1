"""The report of a tune: its record, page, figures, tables, sentences and run directory."""
