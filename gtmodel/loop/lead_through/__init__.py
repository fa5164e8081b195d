"""Lead-through in the loop: the law's twin in Python, its numbers for C, and runs against a synthetic plate."""
