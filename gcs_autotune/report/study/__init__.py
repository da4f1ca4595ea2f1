"""The report of an identification: what there is to tell, its page and its tables."""
