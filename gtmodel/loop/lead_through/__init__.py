"""Lead-through in the loop: the law in Python, its parameters for the C loop, and runs against a synthetic plate."""
