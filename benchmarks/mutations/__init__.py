"""Small faults put into the product one at a time: do the tests that mirror the file notice?"""
