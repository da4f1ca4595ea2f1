"""Common parts of all reports: figures, number formats, tables, pages, terminal output, live lines."""
