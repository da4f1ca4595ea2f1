"""Parts of every report: figures, number formats, tables, pages, terminal output, live lines."""
