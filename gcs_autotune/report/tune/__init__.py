"""The report of a tune: what there is to tell, its page, its pictures, tables and sentences, its run directory."""
