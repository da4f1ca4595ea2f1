"""What every report is made of: pens and pictures, words for numbers, tables, pages, the terminal, live lines."""
